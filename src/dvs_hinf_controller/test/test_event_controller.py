"""Estimator and K against a reference that takes one event at a time by matrix exponentials."""

import contextlib
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EVENT_DTYPE, INDEX_MODULUS, EventPacket
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.event_controller import EventController, PacketReport
from dvs_hinf_controller.running.reference_state import Synchrony
from dvs_hinf_controller.running.sensor_uncertainty import SensorUncertainty

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


@pytest.mark.parametrize('name', CONTROLLERS)
@given(course=courses)
def test_a_packet_at_a_time_is_the_same_as_an_event_at_a_time(name, course):
    found, expected = running(CONTROLLERS[name]), OneAtATime(CONTROLLERS[name])

    for one in packets_of(course):
        report = found.take(one)
        expected.take(one)
        assert (report.lost_events, report.restarted) == (0, False)
        assert_same(found, expected)


@pytest.mark.parametrize('name', ['stable', 'defective', 'stiff', 'static'])
@given(course=st.lists(happenings, min_size=2, max_size=2))
def test_one_packet_of_twice_the_length_is_the_same_as_two(name, course):
    apart, together = running(CONTROLLERS[name]), running(CONTROLLERS[name])
    packets = packets_of(course)
    apart.take(packets[0])
    together.take(packets[0])

    for first, second in zip(packets[1::2], packets[2::2], strict=True):
        apart.take(first)
        apart.take(second)
        early = first.events.copy()
        early['t'] -= MS
        both = np.concatenate([early, second.events])
        together.take(EventPacket(stamp_ns=second.stamp_ns, events=both))
        assert_same(together, apart)


def test_counts_are_integers_that_never_drift():
    there_and_back = running()
    first = there_and_back.estimate.copy()
    index = 0
    for k in range(400):
        rows = [(0, 2, 1 if k % 2 else -1, 1)] * 3
        there_and_back.take(packet(k * MS, rows, index))
        index += 3

    np.testing.assert_array_equal(there_and_back.counts, np.zeros(PIXELS))
    np.testing.assert_array_equal(there_and_back.estimate, first)


def test_before_any_event_the_command_rests_on_the_first_estimate():
    found, expected = running(), OneAtATime(CONTROLLERS['stable'])

    np.testing.assert_allclose(found.estimate, expected.first, rtol=1e-12)
    np.testing.assert_allclose(found.command, expected.command, rtol=1e-12)


def test_the_first_packet_sets_the_clock():
    late, early = running(), running()

    late.take(packet(10**18, [(0, 0, 1, 1)]))
    early.take(packet(0, [(0, 0, 1, 1)]))

    np.testing.assert_array_equal(late.command, early.command)


def test_a_packet_with_the_same_stamp_adds_its_events_at_that_instant():
    twice, once = running(), running()
    for each in (twice, once):
        each.take(packet(0))

    twice.take(packet(MS, [(-5, 0, 1, 1)]))
    twice.take(packet(MS, [(0, 1, -1, 1)], first_index=1))
    once.take(packet(MS, [(-5, 0, 1, 1), (0, 1, -1, 1)]))

    assert_same(twice, once)


def test_an_event_from_before_the_last_packet_acts_from_that_packet_on():
    # A camera with latency or after a loss: K has passed that time already.
    found, expected = running(), running()
    for each in (found, expected):
        each.take(packet(0))
        each.take(packet(MS))

    found.take(packet(2 * MS, [(-int(1.5 * MS), 0, 1, 1)]))
    expected.take(packet(2 * MS, [(-MS, 0, 1, 1)]))

    assert_same(found, expected)


def test_a_stamp_that_does_not_follow_is_refused_and_changes_nothing():
    touched, untouched = running(), running()
    for each in (touched, untouched):
        each.take(packet(5 * SECOND))
        each.take(packet(5 * SECOND + MS, [(-MS, 0, 1, 1), (0, 3, -1, -1)]))

    for stamp_ns in (4 * SECOND, 15 * SECOND, 5 * SECOND):
        with pytest.raises(MessageError, match='s from the last events'):
            touched.take(packet(stamp_ns, [(0, 2, 1, 1)], first_index=2))

    following = packet(5 * SECOND + 2 * MS, [(-3, 2, 1, 1)], first_index=2)
    assert touched.take(following) == untouched.take(following)
    assert_same(touched, untouched, rtol=0)


@pytest.mark.parametrize('step_ns', [-4 * SECOND, 10 * SECOND])
def test_a_clock_that_has_stepped_leaves_unknown_references(step_ns):
    found = running()
    for k in range(3):
        found.take(packet(10 * SECOND + k * MS))
    for k in range(4):
        with pytest.raises(MessageError):
            found.take(packet(10 * SECOND + step_ns + k * MS))

    report = found.take(packet(10 * SECOND + step_ns + 4 * MS))

    assert report.restarted
    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.command, PROBLEM.equilibrium.feedforward)
    found.take_keyframe(keyframe(10 * SECOND + step_ns + 4 * MS, [0] * PIXELS, epoch=8))
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(found.estimate, running().estimate)


def test_a_sensor_that_starts_with_a_new_time_starts_everything_anew():
    again, fresh = running(), running()
    again.take(packet(0))
    again.take_keyframe(keyframe(0, [0] * PIXELS))
    for k in range(1, 30):
        again.take(packet(k * MS, [(-5, k % PIXELS, 1, 1)], first_index=k - 1))

    report = again.take_keyframe(keyframe(0, [0] * PIXELS, epoch=8, next_index=29))
    assert report.restarted
    again.take(packet(0, first_index=29))
    fresh.take(packet(0))
    assert_same(again, fresh, rtol=0)

    following = [(-MS // 3, 4, 1, 1)]
    assert again.take(packet(MS, following, first_index=29)).lost_events == 0
    fresh.take(packet(MS, following))
    assert_same(again, fresh, rtol=0)
    assert again.synchrony is Synchrony.EXACT


@pytest.mark.parametrize(
    ('before', 'first', 'lost'),
    [
        (None, 7, 7),
        (0, 1, 0),
        (0, 4, 3),
        (INDEX_MODULUS - 1, 0, 0),
        (INDEX_MODULUS - 1, 5, 5),
        (INDEX_MODULUS - 3, 1, 3),
    ],
)
def test_a_gap_in_the_index_is_a_loss(before, first, lost):
    found = running()
    found.take(packet(0))
    if before is not None:
        found.take(packet(MS, [(0, 0, 1, 1)], first_index=before))

    assert found.take(packet(2 * MS)).lost_events == 0
    assert found.take(packet(3 * MS, [(0, 0, 1, 1)], first_index=first)).lost_events == lost


def test_a_packet_received_twice_changes_nothing():
    found = running()
    found.take(packet(0))
    once = packet(MS, [(0, 0, 1, 1)])
    found.take(once)
    counts, estimate, command = found.counts, found.estimate.copy(), found.command.copy()

    assert found.take(once).repeated
    np.testing.assert_array_equal(found.counts, counts)
    np.testing.assert_array_equal(found.estimate, estimate)
    np.testing.assert_array_equal(found.command, command)
    assert found.take(packet(2 * MS, [(0, 0, 1, 1)], first_index=1)).lost_events == 0


BAD = {
    'x outside': ('x', WIDTH, 'outside of the 3 x 2 pixels'),
    'y outside': ('y', HEIGHT, 'outside of the 3 x 2 pixels'),
    'after the stamp': ('t', 1, "nor exceed the packet's stamp"),
    'out of order': ('t', -MS + 1, 'must not decrease'),
    'no polarity': ('polarity', 0, r'must be \+1 or -1'),
    'polarity 2': ('polarity', 2, r'must be \+1 or -1'),
    'polarity -128': ('polarity', -128, r'must be \+1 or -1'),
    'no sign': ('sign', 0, r'must be \+1 or -1'),
}


@pytest.mark.parametrize('kind', BAD)
def test_a_packet_that_is_refused_changes_nothing(kind):
    field, value, reason = BAD[kind]
    touched, untouched = running(), running()
    for each in (touched, untouched):
        each.take(packet(0))
        each.take(packet(MS, [(-7, 1, 1, 1)]))
    bad = packet(2 * MS, [(-9, 0, 1, 1), (-5, 5, -1, 1)], first_index=1)
    bad.events[field][1] = value

    with pytest.raises(MessageError, match=reason):
        touched.take(bad)

    following = packet(3 * MS, [(-3, 2, 1, 1)], first_index=1)
    assert touched.take(following) == untouched.take(following)
    assert_same(touched, untouched, rtol=0)


def test_the_command_is_limited_input_by_input():
    free = running()
    limits = np.abs(free.command) * [0.5, 2.0]
    limited = running(limit=limits)

    np.testing.assert_allclose(limited.command[0], math.copysign(limits[0], free.command[0]))
    assert limited.command[1] == free.command[1]


def test_a_limited_command_is_that_of_k_within_the_limits():
    limited, free = running(limit=1e-3), running()
    for each in (limited, free):
        each.take(packet(0))

    np.testing.assert_allclose(limited.command, np.clip(free.command, -1e-3, 1e-3), rtol=0)


# -- keyframes ------------------------------------------------------------------------------------

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
    """What the sensor says of its counts after these packets."""
    sensor = OneAtATime(CONTROLLERS['static'])
    for one in packets:
        sensor.take(one)
    signs = np.sign(sensor.estimate).astype(np.int8)
    number = sum(len(one.events) for one in packets)
    return keyframe(packets[-1].stamp_ns, sensor.counts, signs=signs, next_index=number)


@pytest.mark.parametrize('told', [2, 3, 4, 5], ids='told at {}'.format)
@pytest.mark.parametrize('about', [3, 4], ids='about {}'.format)
def test_a_keyframe_puts_the_counts_right_after_a_loss(told, about):
    packets = packets_of(COURSE)
    whole, lossy = running(), running()
    for number, one in enumerate(packets):
        whole.take(one)
        if number != 2:
            lossy.take(one)
        if number == told:
            lossy.take_keyframe(keyframe_after(packets[: about + 1]))

    assert lossy.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(lossy.counts, whole.counts)
    np.testing.assert_array_equal(lossy.estimate, whole.estimate)


def test_a_keyframe_confirms_what_was_counted():
    packets = packets_of(COURSE)
    found = running()
    assert found.synchrony is Synchrony.UNVERIFIED
    for one in packets:
        found.take(one)

    assert found.take_keyframe(keyframe_after(packets)).resynchronised_pixels == 0
    assert found.synchrony is Synchrony.EXACT


def test_a_keyframe_of_another_array_is_refused():
    with pytest.raises(MessageError, match='keyframe of 2 pixels, the array has 6'):
        told = keyframe(0, [0] * PIXELS)
        running().take_keyframe(dataclasses.replace(told, counts=np.zeros(2, np.int64)))


def test_a_keyframe_tells_where_references_were_when_counting_began():
    found = running()
    first = found.estimate.copy()
    found.take(packet(MS, [], 0))
    moved = np.linspace(-1, 1, PIXELS)

    assert found.take_keyframe(keyframe(MS, np.arange(PIXELS), moved=moved)) == PacketReport(
        resynchronised_pixels=PIXELS
    )
    growth = PROBLEM.log_base ** (moved + np.arange(PIXELS) * H)
    np.testing.assert_allclose(found.estimate, first * growth, rtol=1e-14)


def test_a_loss_that_no_index_has_shown_is_told_by_a_keyframe():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take(packet(MS, [(0, 0, 1, 1)]))
    found.take(packet(3 * MS))

    assert found.take_keyframe(keyframe(2 * MS, [1, 1, 0, 0, 0, 0], next_index=2)) == PacketReport(
        resynchronised_pixels=1
    )
    assert found.synchrony is Synchrony.EXACT
    assert found.take(packet(4 * MS, [(0, 0, 1, 1)], first_index=2)).lost_events == 0
    assert found.counts.tolist() == [2, 1, 0, 0, 0, 0]


def test_who_comes_into_the_midst_of_an_epoch_knows_nothing_until_the_next_keyframe():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(SECOND, [(0, 0, 1, 1)], first_index=40))
    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.command, PROBLEM.equilibrium.feedforward)

    found.take_keyframe(keyframe(SECOND, np.arange(PIXELS), next_index=41, age_s=1.0))

    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(found.counts, np.arange(PIXELS))


def test_what_is_held_while_nothing_is_known_is_a_choice():
    for holds in (False, True):
        found = EventController(
            PROBLEM,
            CONTROLLERS['stable'],
            event_threshold=H,
            command_limit=np.full(2, np.inf),
            holds_unknown=holds,
        )
        found.take(packet(0))
        found.take(packet(MS, [(-5, 0, 1, 1)], first_index=0))
        last = found.command.copy()
        found.take(packet(2 * MS, [(-5, 0, 1, 1)], first_index=0))
        assert found.synchrony is Synchrony.UNKNOWN
        expected = last if holds else PROBLEM.equilibrium.feedforward
        np.testing.assert_allclose(found.command, expected, rtol=1e-2)
        if not holds:
            np.testing.assert_array_equal(found.command, expected)


# -- changes on the way ---------------------------------------------------------------------------


def initial_estimate(bounds, h):
    return sector(bounds, event_threshold=h, log_base=2.0).initial_estimate


def test_a_new_threshold_starts_from_where_the_references_are():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    moved = np.where(np.arange(PIXELS) == 2, 2 * H, 0.0)
    told = keyframe(MS, [0] * PIXELS, moved=moved, next_index=2, event_threshold=0.05)
    found.take_keyframe(told)
    assert found.event_threshold == H
    found.take(packet(MS, [(-5, 2, 1, 1), (-3, 2, 1, 1)]))
    assert found.event_threshold == H
    found.take(packet(2 * MS))

    bounds = ReferenceBounds(lower=LOWER * 2.0**moved, upper=UPPER * 2.0**moved)
    assert found.event_threshold == 0.05
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_allclose(found.estimate, initial_estimate(bounds, 0.05), rtol=1e-12)


def test_a_threshold_told_too_late_is_made_good_from_the_packets_since():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take(packet(2 * MS, [(-5, 2, 1, 1)]))
    found.take_keyframe(keyframe(MS, [0] * PIXELS, event_threshold=0.05))

    assert found.event_threshold == 0.05
    assert found.synchrony is Synchrony.EXACT
    expected = initial_estimate(PROBLEM.bounds, 0.05) * 2.0 ** (0.05 * np.eye(PIXELS)[2])
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-12)


def test_two_changes_of_the_threshold_while_away_are_no_restart():
    found = running()
    found.take_keyframe(keyframe(SECOND, [1] * PIXELS, moved=0.3, event_threshold=0.05))
    found.take(packet(SECOND))

    assert found.synchrony is Synchrony.EXACT
    assert found.event_threshold == 0.05
    moved = 2.0 ** np.full(PIXELS, 0.3)
    bounds = ReferenceBounds(lower=LOWER * moved, upper=UPPER * moved)
    expected = initial_estimate(bounds, 0.05) * 2.0**0.05
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-12)


# -- a sensor that starts again -------------------------------------------------------------------


def test_a_sensor_that_starts_again_tells_where_its_references_are_now():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    for one in packets_of(COURSE):
        found.take(one)
    now = LOWER * 3
    stamp_ns = (len(COURSE) + 1) * MS
    found.take_keyframe(keyframe(stamp_ns, [0] * PIXELS, epoch=8, lower=now, upper=now))
    found.take(packet(stamp_ns))

    assert found.synchrony is Synchrony.EXACT
    bounds = ReferenceBounds(lower=now, upper=now)
    np.testing.assert_allclose(found.estimate, initial_estimate(bounds, H), rtol=1e-12)
    with pytest.raises(MessageError, match='epoch 7, which is over'):
        found.take_keyframe(keyframe(stamp_ns, [0] * PIXELS))
    assert found.take(packet(stamp_ns + MS, [(-5, 2, 1, 1)], 0)).lost_events == 0


def test_a_sensor_that_can_not_tell_where_its_references_are_leaves_them_unknown():
    found = running()
    found.take(packet(0))
    nothing, anything = np.zeros(PIXELS), np.full(PIXELS, np.inf)
    found.take_keyframe(keyframe(0, [0] * PIXELS, lower=nothing, upper=anything))

    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.estimate, nothing)
    y = np.linspace(0.5, 0.6, PIXELS)
    found.take_anchor(Anchor(stamp_ns=0, luminosity=y))
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_allclose(found.estimate, y, rtol=H)


def test_a_number_that_goes_back_is_no_loss_but_another_sensor():
    found = running()
    for one in packets_of(COURSE):
        found.take(one)

    report = found.take(packet(9 * MS, [(-5, 2, 1, 1)], 0))

    assert report == PacketReport()
    assert found.synchrony is Synchrony.UNKNOWN
    assert found.take(packet(10 * MS, [(-5, 2, 1, 1)], 4)).lost_events == 3
    assert found.synchrony is not Synchrony.EXACT


def test_an_epoch_that_is_over_is_taken_again_only_after_several_keyframes():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take_keyframe(keyframe(0, [0] * PIXELS, epoch=8))
    for _ in range(2):
        with pytest.raises(MessageError, match='which is over'):
            found.take_keyframe(keyframe(0, [3] * PIXELS))
    assert found.counts.tolist() == [0] * PIXELS

    found.take_keyframe(keyframe(0, [3] * PIXELS))
    assert found.counts.tolist() == [3] * PIXELS


# -- anchors --------------------------------------------------------------------------------------


def with_anchors(mask=(), **uncertainty):
    return EventController(
        PROBLEM,
        CONTROLLERS['stable'],
        event_threshold=H,
        command_limit=np.full(2, np.inf),
        uncertainty=SensorUncertainty(**uncertainty),
        pixel_mask=mask,
    )


def test_an_anchor_waits_for_the_packet_of_its_stamp_and_counts_what_came_after():
    early, late = with_anchors(), with_anchors()
    y = (LOWER + UPPER) / 2 * 1.02
    anchor = Anchor(stamp_ns=2 * MS, luminosity=y)
    late_rows = [(2 * MS, [(-5, 1, 1, 1)], 0), (3 * MS, [(-5, 1, 1, 1)], 1)]
    for each in (early, late):
        each.take(packet(0))
    early.take_anchor(anchor)
    assert early.references.anchors.used == 0
    for row in late_rows:
        early.take(packet(*row))
        late.take(packet(*row))
    late.take_anchor(anchor)

    assert early.references.anchors.used == late.references.anchors.used == 1
    np.testing.assert_allclose(early.estimate, late.estimate, rtol=1e-12)
    assert np.any(early.estimate != running().estimate)


@pytest.mark.parametrize('stamp_ns', [-MS, 9 * SECOND])
def test_an_anchor_of_forgotten_times_changes_nothing(stamp_ns):
    found = with_anchors()
    found.take(packet(0))
    before = found.estimate.copy()
    anchor = Anchor(stamp_ns=stamp_ns, luminosity=np.full(PIXELS, 9.0))
    if stamp_ns > 0:
        with pytest.raises(MessageError, match='anchor stamped'):
            found.take_anchor(anchor)
    else:
        found.take_anchor(anchor)
        assert found.references.anchors.unused == 1
    np.testing.assert_array_equal(found.estimate, before)


def test_what_waits_for_its_packet_is_bounded_and_none_of_the_far_future_blocks_it():
    found = with_anchors(anchor=0.01)
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    for far in (2_000 * MS, 10**15):
        with pytest.raises(MessageError, match='from the last events'):
            found.take_anchor(Anchor(stamp_ns=far, luminosity=np.ones(PIXELS)))
        with pytest.raises(MessageError, match='from the last events'):
            found.take_keyframe(keyframe(far, [9] * PIXELS, event_threshold=0.2))
    for k in range(1000):
        found.take_anchor(
            Anchor(stamp_ns=(k + 1) * MS // 2, luminosity=PROBLEM.set_point_luminosity)
        )
        found.take_keyframe(keyframe((k + 1) * MS // 2, [0] * PIXELS))

    found.take(packet(501 * MS))

    anchors = found.references.anchors
    assert 0 < anchors.used + anchors.unused <= 16
    assert found.event_threshold == H
    assert found.synchrony is Synchrony.EXACT


def test_an_anchor_of_another_array_is_refused():
    with pytest.raises(MessageError, match='anchor of 2 pixels, the array has 6'):
        running().take_anchor(Anchor(stamp_ns=0, luminosity=np.ones(2)))


def test_a_hot_pixel_is_masked_and_the_mean_goes_over_the_others():
    found = with_anchors(anchor=0.01)
    y = PROBLEM.set_point_luminosity
    found.take_keyframe(keyframe(0, [0] * PIXELS, lower=y, upper=y))
    for k in range(200):
        rows = [(-7, 3, 1, 1), (-5, 3, 1, 1)]
        found.take(packet(k * MS, rows, 2 * k))
        if k % 30 == 29:
            found.take_anchor(Anchor(stamp_ns=k * MS, luminosity=y))

    healthy = np.arange(PIXELS) != 3
    assert found.references.health.healthy.tolist() == healthy.tolist()
    others = with_anchors(mask=(3,), anchor=0.01)
    others.take_keyframe(keyframe(0, [0] * PIXELS, lower=y, upper=y))
    others.take(packet(0))
    np.testing.assert_array_equal(found.estimate[healthy], others.estimate[healthy])
    assert found.estimate[3] / y[3] > 10 or found.estimate[3] / y[3] < 2
    np.testing.assert_allclose(others.estimate[healthy], y[healthy], rtol=H)


def test_another_set_point_keeps_what_is_known_of_the_pixels():
    moved = dataclasses.replace(
        PROBLEM, equilibrium=PROBLEM.model.equilibrium([0.3, -0.1], tolerance=1e-9)
    )
    found, before = running(), running()
    for each in (found, before):
        each.take(packet(0))
        each.take(packet(MS, [(-5, 2, 1, 1)]))

    found.redirect(moved, CONTROLLERS['stable'])

    np.testing.assert_array_equal(found.estimate, before.estimate)
    # c'x_d grows by 0.2, the feedforward -A x_d by (-0.2, 0).
    change = -0.2 * CONTROLLERS['stable'].feedthrough + [-0.2, 0]
    np.testing.assert_allclose(found.command, before.command + change, rtol=1e-12)


packets = st.lists(
    st.tuples(
        st.sampled_from([MS, MS, MS, 2 * MS, 0]),
        st.lists(
            st.tuples(
                st.integers(-MS, 0),
                st.integers(0, PIXELS - 1),
                st.sampled_from([1, -1]),
                st.just(1),
            ),
            max_size=2,
        ),
        st.sampled_from(['', '', '', 'keyframe', 'redirect', 'threshold', 'back']),
    ),
    max_size=15,
)


@given(packets)
def test_looking_ahead_changes_no_bit(sequence):
    """The same packets, keyframes, thresholds and set-points to one that looks ahead or not."""
    plain, ahead = running(), running()
    stamp_ns, index, epoch = 0, 0, 7
    for duration_ns, rows, happening in sequence:
        stamp_ns = 0 if happening == 'back' else stamp_ns + duration_ns
        epoch += happening == 'back'
        h = 0.5 * H if happening == 'threshold' else H
        told = keyframe(
            stamp_ns, np.arange(PIXELS), epoch=epoch, next_index=index, event_threshold=h
        )
        for controller in (plain, ahead):
            if happening == 'redirect':
                further = dataclasses.replace(
                    PROBLEM, equilibrium=PROBLEM.model.equilibrium([0.3, 0.2], tolerance=1e-9)
                )
                controller.redirect(further, CONTROLLERS['stable'])
            elif happening:
                controller.take_keyframe(told)
        foreseen = ahead.foreseen(packet(stamp_ns, rows, index))
        for controller in (plain, ahead):
            with contextlib.suppress(MessageError):
                controller.take(packet(stamp_ns, rows, index))
        assert ahead.command.tobytes() == plain.command.tobytes()
        assert foreseen is None or foreseen.tobytes() == plain.command.tobytes()
        assert ahead.estimate.tobytes() == plain.estimate.tobytes()
        ahead.look_ahead()
        index += len(rows)


def test_the_answer_to_silence_is_foreseen_and_no_other():
    controller = running()
    controller.take(packet(0))
    controller.take(packet(MS, [(0, 0, 1, 1)]))
    controller.look_ahead()

    assert controller.foreseen(packet(2 * MS)) is not None
    assert controller.foreseen(packet(MS)) is None
    assert controller.foreseen(packet(3 * MS)) is None
    assert controller.foreseen(packet(2 * MS, [(0, 0, 1, 1)], 1)) is None
    controller.take_keyframe(keyframe(2 * MS, np.arange(PIXELS), epoch=7, next_index=1))
    assert controller.foreseen(packet(2 * MS)) is None


def test_counts_that_no_light_explains_are_refused_and_not_trusted():
    controller = running()
    controller.take(packet(0))
    before = controller.estimate.copy()

    with pytest.raises(MessageError, match='the luminosity is not physically possible'):
        controller.take(packet(MS, [(k - 5000, 0, 1, 1) for k in range(5000)]))

    assert np.array_equal(controller.estimate, before)
    assert np.isfinite(controller.command).all()
    assert controller.take(packet(2 * MS, [(0, 0, 1, 1)], 5000)).lost_events == 5000
    assert controller.synchrony is Synchrony.LOST


@pytest.mark.parametrize('numbers', [{'counts': [2**31] * PIXELS}, {'moved': 900.0}])
def test_a_keyframe_beyond_all_numbers_changes_nothing(numbers):
    controller = running()
    controller.take(packet(0))
    before = controller.estimate.copy()

    with pytest.raises(MessageError, match='the luminosity is not physically possible'):
        controller.take_keyframe(keyframe(0, **{'counts': [0] * PIXELS, **numbers}))

    assert np.array_equal(controller.estimate, before)
    assert np.isfinite(controller.command).all()
