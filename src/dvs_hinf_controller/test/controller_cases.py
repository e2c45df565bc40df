"""A controller and the messages that its tests give it, and a reference in matrix exponentials."""

import numpy as np
from hypothesis import strategies as st
from scipy.linalg import expm

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.events import EVENT_DTYPE, INDEX_MODULUS, EventPacket
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty

MS = 1_000_000
SECOND = 1000 * MS
H = 0.1
HEIGHT, WIDTH = 2, 3
PIXELS = HEIGHT * WIDTH
LOWER = np.linspace(0.4, 0.6, PIXELS)
UPPER = LOWER * np.linspace(1.0, 1.1, PIXELS)


def problem():
    model = PlantModel(
        state_matrix=[[2, 10], [0, 5]], input_matrix=np.eye(2), output_vector=[2, 1]
    )
    return DesignProblem(
        model=model,
        equilibrium=model.equilibrium([0.2, -0.1], tolerance=1e-9),
        scene=PixelScene(
            brightness_offsets=np.linspace(-0.1, 0.1, PIXELS), height=HEIGHT, width=WIDTH
        ),
        bounds=ReferenceBounds(lower=LOWER, upper=UPPER),
        tolerance=0.05,
        log_base=2.0,
    )


PROBLEM = problem()


def gains(a, seed=0):
    generator = np.random.default_rng(seed)
    k = len(a)
    return LinearController(
        state_matrix=a,
        input_vector=generator.standard_normal(k),
        output_matrix=generator.standard_normal((2, k)),
        feedthrough=generator.standard_normal(2),
    )


CONTROLLERS = {
    'stable': gains(np.array([[-3.0, 1.0, 0.0], [-1.0, -3.0, 2.0], [0.5, 0.0, -5.0]])),
    'unstable': gains(np.array([[4.0, 1.0], [0.0, -3.0]])),
    'defective': gains(np.array([[-2.0, 1.0, 0.0], [0.0, -2.0, 1.0], [0.0, 0.0, -2.0]])),
    'integrators': gains(np.array([[0.0, 1.0], [0.0, 0.0]])),
    'stiff': gains(np.array([[-1e6, 3e3, 0.0], [0.0, -2e3, 1.0], [0.0, 0.0, -2.0]])),
    'static': gains(np.zeros((0, 0))),
}


def running(controller=CONTROLLERS['stable'], limit=np.inf):
    return EventController(
        PROBLEM, controller, event_threshold=H, command_limit=np.broadcast_to(limit, (2,))
    )


def packet(stamp_ns, rows=(), first_index=0):
    """Packet of (time relative to the stamp, pixel, polarity, sign), sorted as the camera does."""
    events = np.zeros(len(rows), EVENT_DTYPE)
    for k, (t, pixel, polarity, sign) in enumerate(sorted(rows, key=lambda row: row[:2])):
        y, x = divmod(pixel, WIDTH)
        events[k] = (x, y, t, (first_index + k) % INDEX_MODULUS, polarity, sign)
    return EventPacket(stamp_ns=stamp_ns, events=events)


class OneAtATime:
    """The continuous-time controller, integrated from event to event."""

    def __init__(self, controller):
        self.k = controller
        rho = 2.0**-H
        self.first = 2 * LOWER * UPPER * rho / (UPPER + LOWER * rho**2)
        self.counts = np.zeros(PIXELS, int)
        self.estimate = self.first.copy()
        self.state = np.zeros(controller.order)
        self.target = np.mean([2 * 0.2 - 0.1 + d for d in np.linspace(-0.1, 0.1, PIXELS)])
        self.stamp_ns = None

    @property
    def deviation(self):
        return self.estimate.mean() - self.target

    @property
    def command(self):
        feedforward = -np.array([2 * 0.2 - 10 * 0.1, -5 * 0.1])
        k = self.k
        return k.output_matrix @ self.state + k.feedthrough * self.deviation + feedforward

    def hold(self, duration_ns):
        n = self.k.order
        augmented = np.zeros((n + 1, n + 1))
        augmented[:n, :n] = self.k.state_matrix
        augmented[:n, n] = self.k.input_vector
        step = expm(augmented * (duration_ns * 1e-9))
        self.state = step[:n, :n] @ self.state + step[:n, n] * self.deviation

    def take(self, packet):
        now = packet.stamp_ns if self.stamp_ns is None else self.stamp_ns
        for event in packet.events:
            at = max(packet.stamp_ns + int(event['t']), now)
            self.hold(at - now)
            now = at
            pixel = int(event['y']) * WIDTH + int(event['x'])
            self.counts[pixel] += event['polarity']
            self.estimate[pixel] = (
                event['sign'] * self.first[pixel] * 2.0 ** (H * self.counts[pixel])
            )
        self.hold(packet.stamp_ns - now)
        self.stamp_ns = packet.stamp_ns


# An event, or the two of a change of sign: OFF with the old sign and ON with the new one.
single = st.tuples(st.just(False), st.sampled_from([1, -1]))
change_of_sign = st.tuples(st.just(True), st.sampled_from([1, -1]))
moments = st.one_of(st.sampled_from([0, -1, -MS // 2, 1 - MS]), st.integers(1 - MS, 0))
happenings = st.lists(
    st.tuples(moments, st.integers(0, PIXELS - 1), st.one_of(single, change_of_sign)), max_size=12
)
courses = st.lists(happenings, min_size=1, max_size=4)


def packets_of(course, period_ns=MS):
    index = 0
    made = []
    for k, happened in enumerate(course, start=1):
        rows = []
        for t, pixel, (changes_sign, value) in happened:
            if changes_sign:
                rows += [(t, pixel, -1, value), (t, pixel, 1, -value)]
            else:
                rows.append((t, pixel, value, 1))
        made.append(packet(k * period_ns, rows, index))
        index = (index + len(rows)) % INDEX_MODULUS
    return [packet(0), *made]


def assert_same(found, expected, rtol=1e-9):
    np.testing.assert_array_equal(found.counts, expected.counts)
    np.testing.assert_allclose(found.estimate, expected.estimate, rtol=1e-12)
    np.testing.assert_allclose(found.command, expected.command, rtol=rtol, atol=rtol)


COURSE = [
    [(-9, 0, (False, 1)), (-4, 3, (False, 1))],
    [(-MS // 2, 3, (False, 1)), (-5, 4, (True, 1))],
    [(-7, 3, (False, -1)), (0, 5, (False, -1))],
    [(-3, 4, (False, 1)), (-1, 0, (False, 1))],
    [(-2, 1, (False, -1))],
]


def keyframe(stamp_ns, counts, *, signs=1, moved=0.0, epoch=7, **others):
    """State of a sensor that has counted `counts` since its references were `moved`."""
    counts = np.array(counts, np.int64)
    growth = PROBLEM.log_base ** np.broadcast_to(moved, counts.shape)
    values = {
        'age_s': 0.0,
        'events': 0,
        'next_index': 0,
        'event_threshold': H,
        'lower': LOWER * growth,
        'upper': UPPER * growth,
        **others,
    }
    return Keyframe(
        stamp_ns=stamp_ns,
        epoch=epoch,
        counts=counts,
        signs=np.broadcast_to(signs, counts.shape).astype(np.int8),
        **values,
    )


def keyframe_after(packets):
    """Keyframe that the sensor publishes after these packets."""
    sensor = OneAtATime(CONTROLLERS['static'])
    for one in packets:
        sensor.take(one)
    signs = np.sign(sensor.estimate).astype(np.int8)
    number = sum(len(one.events) for one in packets)
    return keyframe(packets[-1].stamp_ns, sensor.counts, signs=signs, next_index=number)


def initial_estimate(bounds, h):
    return sector(bounds, event_threshold=h, log_base=2.0).initial_estimate


def with_anchors(mask=(), **uncertainty):
    return EventController(
        PROBLEM,
        CONTROLLERS['stable'],
        event_threshold=H,
        command_limit=np.full(2, np.inf),
        uncertainty=SensorUncertainty(**uncertainty),
        pixel_mask=mask,
    )
