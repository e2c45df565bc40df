"""What is known of every reference contains the truth, whatever happens to sensor and messages."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.cdr import MessageError
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.running.interval_arithmetic import SensorBounds
from dvs_hinf_controller.running.intervals import ReferenceIntervals
from dvs_hinf_controller.running.packet_history import Counted, PacketHistory
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty

H = 0.1
PIXELS = 3
SECOND = 1_000_000_000
MS = 1_000_000
BOUNDS = ReferenceBounds(lower=np.array([0.4, 0.5, 0.6]), upper=np.array([0.4, 0.52, 0.66]))
IDEAL = SensorUncertainty()
ROUNDING = 1 + 1e-8


def intervals(uncertainty=IDEAL, bounds=BOUNDS, **arguments):
    return ReferenceIntervals(
        bounds, event_threshold=H, log_base=math.e, uncertainty=uncertainty, **arguments
    )


def events(*rows):
    """Arrays of (pixel, polarity)."""
    pixels, polarities = np.array(rows or np.empty((0, 2)), np.int64).T
    return pixels.astype(np.intp), polarities.astype(np.int8), np.ones(len(pixels), np.int8)


def after(history=None, stamp_ns=0, now_ns=0, latency_ns=0):
    history = history or PacketHistory()
    return history.since(stamp_ns, now_ns=now_ns, latency_ns=latency_ns, pixel_count=PIXELS)


class Sensor:
    """A true sensor within its uncertainty, and what a consumer makes of its messages."""

    def __init__(self, uncertainty, draw):
        self.uncertainty, self.draw = uncertainty, draw
        self.now_ns = self.began_ns = self.index = self.noted = 0
        self.known = intervals(uncertainty)
        self.start(BOUNDS)
        self.history = PacketHistory()

    def start(self, bounds):
        fraction = np.array([self.draw() for _ in range(PIXELS)])
        self.first = bounds
        self.log_q = np.log(bounds.lower * (bounds.upper / bounds.lower) ** fraction)
        # A pixel that leaks is anywhere in its cycle.
        self.log_q -= bool(self.uncertainty.leak) * H * self.draw()
        spread = [self.uncertainty.threshold_on, self.uncertainty.threshold_off]
        signs = [2 * self.draw() - 1 for _ in spread]
        self.thresholds = [H * (1 + e * s) for e, s in zip(spread, signs, strict=True)]
        self.counts = np.zeros(PIXELS, np.int64)
        self.number = 0
        self.began_ns = self.now_ns

    def pass_time(self, duration_ns):
        self.now_ns += duration_ns
        self.log_q -= self.uncertainty.leak * self.draw() * H * duration_ns * 1e-9

    def fire(self, rows, *, lost):
        for pixel, polarity in rows:
            self.log_q[pixel] += polarity * self.thresholds[polarity < 0]
            self.counts[pixel] += polarity
        self.number += len(rows)
        if lost:
            self.noted += len(rows)
            return
        pixels, polarities, signs = events(*rows)
        if self.noted:
            self.known.lose(self.noted)
        if len(rows):
            self.known.apply(pixels, polarities, signs)
        self.history.add(
            Counted(
                stamp_ns=self.now_ns,
                times_ns=np.zeros(len(rows), np.int32),
                pixels=pixels,
                polarities=polarities,
                signs=signs,
                next_index=0,
                lost=self.noted,
            )
        )
        self.noted = 0

    def given(self):
        return SensorBounds(
            event_threshold=H,
            counts=self.counts.copy(),
            signs=np.ones(PIXELS, np.int8),
            lower=self.first.lower,
            upper=self.first.upper,
            age_s=(self.now_ns - self.began_ns) * 1e-9,
            events=self.number,
        )

    def luminosity(self):
        """Light in which no pixel fires, and a measurement of it."""
        low, high = -self.thresholds[1], self.thresholds[0]
        level = self.log_q + np.array([low + (high - low) * self.draw() for _ in range(PIXELS)])
        error = self.uncertainty.anchor
        factors = [1 - error + 2 * error * self.draw() for _ in range(PIXELS)]
        return np.exp(level), np.exp(level) * factors


def assert_contains_the_truth(sensor):
    known, q = sensor.known, np.exp(sensor.log_q - sensor.known.counts * H)
    assert np.all(known.lower <= q * ROUNDING)
    assert np.all(q <= known.upper * ROUNDING)
    y, _ = sensor.luminosity()
    error = np.abs(known.estimate - y)[known.known]
    assert np.all(error <= (known.error_bounds * y)[known.known] * ROUNDING + 1e-12)
    assert np.isfinite(known.estimate).all() and np.isfinite(known.mean_estimate)


HAPPENINGS = ['events'] * 5 + ['lost', 'keyframe', 'anchor', 'late anchor', 'restart', 'forget']


@pytest.mark.ensemble
@settings(max_examples=300, deadline=None)
@given(
    data=st.data(),
    bounds=st.tuples(*[st.sampled_from([0.0, 0.02, 0.2])] * 2),
    leak=st.sampled_from([0.0, 0.5, 20.0]),
    anchor=st.sampled_from([0.0, 0.01, 0.1]),
)
def test_the_true_reference_lies_in_its_interval_at_every_instant(data, bounds, leak, anchor):
    """Events, mismatch, leak, losses, keyframes, anchors late or not, restarts (must hold 2)."""
    uncertainty = SensorUncertainty(
        threshold_on=bounds[0], threshold_off=bounds[1], leak=leak, anchor=anchor
    )
    sensor = Sensor(uncertainty, lambda: data.draw(st.sampled_from([0.0, 0.3, 0.5, 0.9, 1.0])))
    measured = None
    for happening in data.draw(st.lists(st.sampled_from(HAPPENINGS), max_size=12)):
        duration_ns = data.draw(st.sampled_from([MS, 100 * MS]))
        sensor.pass_time(duration_ns)
        sensor.known.leak(duration_ns * 1e-9)
        if happening in ('events', 'lost'):
            row = st.tuples(st.integers(0, PIXELS - 1), st.sampled_from([1, -1]))
            sensor.fire(data.draw(st.lists(row, max_size=4)), lost=happening == 'lost')
        elif happening == 'keyframe':
            sensor.fire([], lost=False)
            sensor.known.confirm(sensor.given())
        elif happening == 'anchor' and not sensor.noted:
            # An anchor waits for the packet of its stamp, which shows every loss before it.
            _, y = measured = sensor.now_ns, sensor.luminosity()[1]
            sensor.known.cut(y, after(sensor.history, sensor.now_ns, sensor.now_ns))
        elif happening == 'late anchor' and measured is not None:
            passed = after(sensor.history, measured[0], sensor.now_ns)
            sensor.known.cut(measured[1], passed)
        elif happening == 'restart':
            measured = None
            sensor.start(BOUNDS)
            sensor.noted = 0
            sensor.known.restart(sensor.given())
        elif happening == 'forget':
            sensor.known.forget()
        if not sensor.noted:
            assert_contains_the_truth(sensor)


# -- rule by rule ---------------------------------------------------------------------------------


def test_an_ideal_sensor_gives_the_bits_of_the_papers_estimate():
    known = intervals()
    rows = [(0, 1), (2, -1), (2, -1), (0, 1), (0, 1)]
    known.apply(*events(*rows))
    known.leak(100.0)

    first = sector(BOUNDS, event_threshold=H, log_base=math.e).initial_estimate
    expected = first * np.exp(np.array([3, 0, -2]) * H)
    assert known.estimate.tobytes() == expected.tobytes()
    assert np.array_equal(known.lower, BOUNDS.lower)
    assert np.array_equal(known.upper, BOUNDS.upper)


def test_a_leak_lowers_the_lower_end_and_nothing_else():
    known = intervals(SensorUncertainty(leak=2.0))
    lower, upper = known.lower.copy(), known.upper.copy()

    known.leak(0.5)

    np.testing.assert_allclose(known.lower, lower * math.exp(-H), rtol=1e-12)
    assert np.array_equal(known.upper, upper)


def test_what_a_loss_has_added_goes_with_a_keyframe():
    known = intervals()
    known.apply(*events((0, 1), (1, -1)))
    known.lose(2)
    assert known.half_widths == pytest.approx(0.5 * np.log(BOUNDS.upper / BOUNDS.lower) + 2 * H)
    known.apply(*events((1, 1)))
    sensor = Sensor(IDEAL, lambda: 0.0)
    sensor.counts = np.array([2, 0, 1])

    assert known.confirm(sensor.given()) == 2

    assert np.array_equal(known.lower, BOUNDS.lower)
    assert np.array_equal(known.upper, BOUNDS.upper)
    assert known.counts.tolist() == [2, 0, 1]


def test_so_many_lost_events_that_nothing_is_known_leave_an_estimate_that_is_not_certified():
    known = intervals()
    before = known.estimate.copy()

    known.lose(2**31)

    assert not known.known.any()
    assert np.array_equal(known.error_bounds, np.ones(PIXELS))
    np.testing.assert_allclose(known.estimate, before)


def test_a_reference_that_nothing_is_known_of_is_no_number():
    known = intervals()
    known.forget()

    assert not known.known.any()
    assert known.active_count == 0
    assert known.mean_estimate == 0.0
    assert np.array_equal(known.estimate, np.zeros(PIXELS))
    assert np.array_equal(known.apply(*events((0, 1))), [0.0])

    known.cut(np.array([0.5, np.nan, -1.0]), after())
    assert known.known.tolist() == [True, False, False]
    assert known.mean_estimate == pytest.approx(0.5, rel=H)


def test_an_anchor_is_worth_its_error_near_an_event_and_a_threshold_more_at_a_bad_instant():
    error = 0.01
    known = intervals(SensorUncertainty(anchor=error))
    known.forget()
    known.cut(np.full(PIXELS, 0.5), after())
    assert known.half_widths == pytest.approx(H + error, abs=1e-5)

    # The same reference seen just before an ON and just before an OFF event.
    known.cut(np.full(PIXELS, 0.5 * math.exp(0.999 * 2 * H)), after())
    assert known.half_widths == pytest.approx(error, abs=2e-4)


def test_an_anchor_against_every_bound_replaces_what_was_known():
    known = intervals(SensorUncertainty(anchor=0.01))
    y = np.array([0.4, 0.5, 2.0])

    cut = known.cut(y, after())

    assert cut.confirmed.tolist() == [True, True, False]
    assert cut.contradicted.tolist() == [False, False, True]
    assert known.lower[2] == pytest.approx(2.0 * math.exp(-H) / 1.01)
    assert known.upper[2] == pytest.approx(2.0 * math.exp(H) / 0.99)


def test_events_that_may_have_come_before_an_anchor_widen_it():
    history = PacketHistory()
    pixels, polarities, signs = events((0, 1), (1, -1))
    packet = Counted(
        stamp_ns=10 * MS,
        times_ns=np.array([-9 * MS, -4 * MS], np.int32),
        pixels=pixels,
        polarities=polarities,
        signs=signs,
        next_index=0,
        lost=0,
    )
    history.add(packet)
    passed = after(history, 0, 10 * MS, latency_ns=2 * MS)
    assert passed.on.tolist() == passed.unsure_on.tolist() == [1, 0, 0]
    assert passed.off.tolist() == [0, 1, 0]
    assert passed.unsure_off.tolist() == [0, 0, 0]

    sure, unsure = intervals(), intervals()
    for known in (sure, unsure):
        known.apply(pixels, polarities, signs)
        known.forget()
    y = np.full(PIXELS, 0.5)
    sure.cut(y, after(history, 0, 10 * MS))
    unsure.cut(y, passed)
    assert unsure.lower[0] == pytest.approx(sure.lower[0] * math.exp(-H))
    assert np.array_equal(unsure.lower[1:], sure.lower[1:])
    assert np.array_equal(unsure.upper, sure.upper)


@pytest.mark.parametrize('numbers', [{'threshold_on': 1.0}, {'leak': -1.0}, {'anchor': math.nan}])
def test_a_bound_that_is_none_is_refused_by_name(numbers):
    with pytest.raises(ParameterError, match=f'{next(iter(numbers))}_uncertainty'):
        SensorUncertainty(**numbers)


def test_counts_out_of_all_numbers_change_nothing():
    for compiled, size in ((False, 5000), (True, 5000)):
        known = intervals(compiled=compiled)
        known.apply(*events((1, 1), (2, -1)))
        before = known.estimate.copy()
        with pytest.raises(MessageError, match='the luminosity is not physically possible'):
            known.apply(*events(*[(0, 1), (1, -1), (2, 1), (2, -1)] * size))
        assert known.counts.tolist() == [0, 1, -1]
        assert known.estimate.tobytes() == before.tobytes()


@given(
    seed=st.integers(0, 2**31),
    uncertain=st.booleans(),
    masked=st.booleans(),
)
@settings(max_examples=20, deadline=None)
def test_compiled_code_gives_the_same_bits(seed, uncertain, masked):
    generator = np.random.default_rng(seed)
    size, pixels = 6000, 500
    bounds = ReferenceBounds(
        lower=generator.uniform(0.4, 0.5, pixels), upper=generator.uniform(0.5, 0.6, pixels)
    )
    uncertainty = SensorUncertainty(threshold_on=0.1 * uncertain, leak=1.0 * uncertain)
    found = [intervals(uncertainty, bounds, compiled=compiled) for compiled in (False, True)]
    healthy = generator.random(pixels) < (0.9 if masked else 2.0)
    batch = (
        generator.integers(pixels, size=size),
        (2 * generator.integers(2, size=size) - 1).astype(np.int8),
        (2 * generator.integers(2, size=size) - 1).astype(np.int8),
    )
    jumps = []
    for known in found:
        known.restrict_to(healthy)
        jumps.append(known.apply(*batch))
    assert jumps[0].tobytes() == jumps[1].tobytes()
    assert found[0].estimate.tobytes() == found[1].estimate.tobytes()
    assert found[0].counts.tobytes() == found[1].counts.tobytes()
    assert found[0].lower.tobytes() == found[1].lower.tobytes()


def test_the_carried_mean_of_very_many_pixels_is_that_of_all_of_them():
    generator = np.random.default_rng(5)
    pixels = 40_000
    lower = generator.uniform(0.4, 0.5, pixels)
    known = intervals(bounds=ReferenceBounds(lower=lower, upper=lower))
    known.restrict_to(generator.random(pixels) < 0.9)
    assert known.mean_estimate == known.estimate[known.active].mean()
    for _ in range(12):
        size = 5000
        polarities = (2 * generator.integers(2, size=size) - 1).astype(np.int8)
        known.apply(generator.integers(pixels, size=size), polarities, np.ones(size, np.int8))
        mean = known.estimate[known.active].mean()
        assert known.mean_estimate == pytest.approx(mean, rel=1e-14)
    known.forget()
    assert known.mean_estimate == 0.0
