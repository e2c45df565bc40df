"""The ideal pixel: trigger, counts, stamps and start, against the paper and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_event_camera.pixels.photoreceptor import (
    LinLogPhotoreceptor,
    LogPhotoreceptor,
    SignedLogPhotoreceptor,
)
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents

MS = 1_000_000

walks = st.lists(st.lists(st.floats(-3, 3), min_size=3, max_size=3), min_size=1, max_size=12).map(
    np.array
)


@given(
    walks,
    st.floats(0.02, 1.0),
    st.sampled_from([2.0, math.e, 10.0]),
    st.sampled_from(['luminosity', 'lower', 'upper', 'random']),
)
@settings(max_examples=200, deadline=None)
def test_reference_stays_within_one_threshold_of_the_luminosity(levels, h, base, kind):
    array = PixelArray(
        event_threshold=h,
        log_base=base,
        reference_uncertainty=1e-3,
        initial_reference=kind,
        seed=3,
    )
    start = array.update(0, np.ones(3))
    assert len(start) == 0
    q0 = np.exp(array.reference_levels)
    total = np.zeros(3, int)
    for k, level in enumerate(levels, start=1):
        events = array.update(k * MS, np.exp(level))
        np.add.at(total, events.pixel, events.polarity)
        assert np.all(events.t > (k - 1) * MS)
        assert np.all(events.t <= k * MS)
        assert_sorted(events)
        change = (level - np.log(q0)) / math.log(base)
        assert np.all(np.abs(change - total * h) < h * (1 + 1e-9))
    assert np.array_equal(total, array.counts)
    assert np.allclose(array.reference_levels, np.log(q0) + total * h * math.log(base))


@pytest.mark.ensemble
@given(
    st.lists(
        st.one_of(st.floats(-2, 2), st.sampled_from([0.0, 0.05, -0.05, 0.0499, -0.0499, 1e-9])),
        min_size=2,
        max_size=25,
    ),
    st.floats(0.02, 1.0),
)
@settings(max_examples=300, deadline=None)
def test_signed_reference_has_the_sign_of_the_luminosity_outside_the_band(samples, h):
    band = 0.05
    array = PixelArray(event_threshold=h, photoreceptor=SignedLogPhotoreceptor(dead_band=band))
    array.update(0, [1.5])
    count, sign = 0, 1
    for k, y in enumerate(samples, start=1):
        events = array.update(k * MS, [y])
        assert_sorted(events)
        assert np.all((events.t > (k - 1) * MS) & (events.t <= k * MS))
        for polarity, event_sign in zip(events.polarity, events.sign, strict=True):
            count += int(polarity)
            sign = int(event_sign)
        gap = math.log(max(abs(y), band)) - (math.log(1.5) + count * h)
        assert abs(gap) < h * (1 + 1e-9)
        if abs(y) >= band:
            assert sign == np.sign(y)
        assert (array.counts[0], array.signs[0]) == (count, sign)


def test_crossing_of_zero_is_down_flip_and_up_with_linear_stamps():
    h, band = 0.5, 0.1
    array = PixelArray(event_threshold=h, photoreceptor=SignedLogPhotoreceptor(dead_band=band))
    array.update(0, [1.0])
    events = array.update(1000 * MS, [-1.0])  # y = 1 - 2 t
    down = [math.exp(-h * k) for k in range(1, 5)]
    up = [math.exp(-h * k) for k in range(3, -1, -1)]
    expected = [(1 - y) / 2 for y in down] + [(1 + band) / 2] * 2 + [(1 + y) / 2 for y in up]
    assert events.polarity.tolist() == [-1] * 4 + [-1, 1] + [1] * 4
    assert events.sign.tolist() == [1] * 4 + [1, -1] + [-1] * 4
    assert np.allclose(events.t * 1e-9, expected, rtol=0, atol=1.01e-9)


def test_pixel_is_silent_inside_the_band_and_its_sign_waits_for_the_edge():
    array = PixelArray(event_threshold=0.3, photoreceptor=SignedLogPhotoreceptor(dead_band=0.1))
    array.update(0, [0.11])
    assert len(array.update(MS, [-0.09])) == 0
    assert len(array.update(2 * MS, [0.05])) == 0
    events = array.update(3 * MS, [-0.1])
    assert events.t.tolist() == [3 * MS] * 2
    assert events.polarity.tolist() == [-1, 1]
    assert events.sign.tolist() == [1, -1]


def test_exponential_luminosity_is_exact_to_the_nanosecond():
    h, rate = 0.1, 3.0
    array = PixelArray(event_threshold=h)
    array.update(0, [2.0])
    stamps, polarities = [], []
    for k in range(1, 101):
        events = array.update(k * 10 * MS, [2.0 * math.exp(-rate * k * 0.01)])
        stamps += events.t.tolist()
        polarities += events.polarity.tolist()
    expected = h * np.arange(1, 30) / rate
    assert polarities[:29] == [-1] * 29
    assert np.allclose(np.array(stamps[:29]) * 1e-9, expected, rtol=0, atol=1.01e-9)


@pytest.mark.parametrize('period_ns', [10 * MS, MS])
def test_ramp_and_sinusoid_have_exact_counts_and_stamps_within_the_bound(period_ns):
    h = 0.07
    time = np.arange(0, 1_000_000_001, period_ns)
    seconds = time * 1e-9
    omega = 2 * math.pi
    ramp, wave = 1 + 2 * seconds, np.exp(0.4 * np.sin(omega * seconds))
    array = PixelArray(event_threshold=h)
    found = [array.update(int(t), y) for t, y in zip(time, np.c_[ramp, wave], strict=True)]
    pixel = np.concatenate([events.pixel for events in found])
    t = np.concatenate([events.t for events in found])[pixel == 0] * 1e-9
    expected = (np.exp(h * np.arange(1, 16)) - 1) / 2
    assert t.size == int(math.log(3) / h) == expected.size
    bound = (period_ns * 1e-9) ** 2 / 8 * 2.0 + 1e-9  # dt^2/8 |L''/L'|, with L''/L' = -2/y
    assert np.all(np.abs(t - expected) <= bound)

    polarity = np.concatenate([events.polarity for events in found])[pixel == 1]
    # Up to 0.35, down to -0.35, up to 0: a hysteresis of one step at each turn.
    assert polarity.tolist() == [1] * 5 + [-1] * 10 + [1] * 4
    t = np.concatenate([events.t for events in found])[pixel == 1] * 1e-9
    levels = np.r_[np.arange(1, 6), np.arange(4, -6, -1), np.arange(-4, 0)] * h
    assert np.allclose(0.4 * np.sin(omega * t), levels, atol=0.4 * (omega * period_ns * 1e-9) ** 2)


def test_several_events_of_many_pixels_are_sorted_by_time_then_pixel():
    array = PixelArray(event_threshold=0.1)
    array.update(0, np.ones(50))
    events = array.update(MS, np.full(50, math.exp(0.55)))
    assert len(events) == 250
    assert events.pixel.tolist() == list(range(50)) * 5
    assert np.unique(events.t).size == 5
    assert events.t.dtype == np.int64
    assert events.pixel.dtype == np.int32
    assert events.polarity.dtype == events.sign.dtype == np.int8


def test_interval_of_hours_keeps_order_and_nanoseconds():
    array = PixelArray(event_threshold=0.1)
    array.update(0, np.ones(300_000))
    hours = 4 * 3600 * 1000 * MS
    y = np.ones(300_000)
    y[[7, 299_999]] = math.exp(0.25)
    events = array.update(hours, y)
    assert events.pixel.tolist() == [7, 299_999, 7, 299_999]
    assert np.allclose(events.t / hours, [0.4, 0.4, 0.8, 0.8], rtol=0, atol=1e-12)


def test_threshold_reached_exactly_fires_at_the_sample_itself():
    array = PixelArray(event_threshold=1.0, log_base=2.0)
    array.update(0, [1.0])
    events = array.update(10, [2.0])
    assert events.t.tolist() == [10]
    assert len(array.update(20, [1.0000001])) == 0
    assert array.update(30, [1.0]).t.tolist() == [30]


def test_counts_are_right_after_hours_of_simulated_time():
    array = PixelArray(event_threshold=0.15, reference_uncertainty=0.01, initial_reference='upper')
    rng = np.random.default_rng(0)
    level = np.zeros(40)
    array.update(0, np.exp(level))
    total = np.zeros(40, int)
    for k in range(1, 4001):
        level = np.clip(level + rng.normal(0, 0.5, 40), -3, 3)
        events = array.update(k * 10_000 * MS, np.exp(level))  # 11 hours
        np.add.at(total, events.pixel, events.polarity)
    assert np.all(np.abs(level - math.log(1.01) - total * 0.15) < 0.15 + 1e-12)
    assert events.t.min() > 11 * 3600 * 1000 * MS


def test_start_that_could_fire_is_refused_with_pixel_and_numbers():
    with pytest.raises(ParameterError, match=r'pixel 1 lies 2\.2\d+ thresholds') as caught:
        PixelArray(event_threshold=0.1, reference_uncertainty=0.2).update(0, [10.0, 1.0])
    assert caught.value.name == 'reference_lower'
    bounds = ReferenceBounds(lower=[1.0, 1.0], upper=[1.05, 1.2])
    with pytest.raises(ParameterError, match='pixel 1'):
        PixelArray(event_threshold=0.1, bounds=bounds).update(0, [1.0, 1.0])
    # Equality fires (eq. 5 says >=), so it is refused as well.
    bounds = ReferenceBounds(lower=[1.0], upper=[2.0])
    with pytest.raises(ParameterError, match='upper'):
        PixelArray(event_threshold=1.0, log_base=2.0, bounds=bounds).update(0, [1.0])


def test_reference_outside_its_bounds_is_refused():
    bounds = ReferenceBounds(lower=[1.01], upper=[1.05])
    with pytest.raises(ParameterError, match='initial_reference'):
        PixelArray(event_threshold=0.1, bounds=bounds).update(0, [1.0])
    PixelArray(event_threshold=0.1, bounds=bounds, initial_reference='random').update(0, [1.0])


def test_random_references_are_seeded_and_within_bounds():
    def start(seed):
        array = PixelArray(
            event_threshold=0.1,
            reference_uncertainty=0.05,
            initial_reference='random',
            seed=seed,
        )
        array.update(0, np.full(100, 2.0))
        return np.exp(array.reference_levels)

    assert np.array_equal(start(1), start(1))
    assert not np.array_equal(start(1), start(2))
    assert start(1).min() >= 1.95
    assert start(1).max() <= 2.05
    assert np.ptp(start(1)) > 0.05


@pytest.mark.parametrize(
    ('receptor', 'bad'),
    [(LogPhotoreceptor(), bad) for bad in (0.0, -1.0, math.nan, math.inf)]
    + [(LinLogPhotoreceptor(), bad) for bad in (-1.0, math.nan, math.inf)],
)
def test_invalid_luminosity_is_counted_and_the_pixel_holds(bad, receptor):
    array = PixelArray(event_threshold=0.1, photoreceptor=receptor)
    array.update(0, [30.0, 30.0])
    events = array.update(MS, [bad, 30.0 * math.exp(0.15)])
    assert events.pixel.tolist() == [1]
    assert array.invalid_samples == 1
    events = array.update(2 * MS, [30.0 * math.exp(0.25), 30.0 * math.exp(0.15)])
    assert events.pixel.tolist() == [0, 0]
    assert events.polarity.tolist() == [1, 1]
    assert array.counts.tolist() == [2, 1]


def test_size_and_time_of_samples_are_checked():
    array = PixelArray(event_threshold=0.1)
    array.update(5, [1.0, 1.0])
    for stamp in (5, 4):
        with pytest.raises(ParameterError, match='stamp_ns'):
            array.update(stamp, [1.0, 1.0])
    with pytest.raises(ParameterError, match='luminosity'):
        array.update(6, [1.0])


@pytest.mark.parametrize(
    ('field', 'value'),
    [('event_threshold', 0.0), ('event_threshold', math.nan), ('log_base', 1.0)],
)
def test_parameters_out_of_range_are_named(field, value):
    arguments = {'event_threshold': 0.1, field: value}
    with pytest.raises(ParameterError, match=field):
        PixelArray(**arguments)


def assert_sorted(events):
    keys = list(zip(events.t.tolist(), events.pixel.tolist(), strict=True))
    assert keys == sorted(keys)


@pytest.mark.parametrize('far', [1000, 2**50])
def test_order_is_total_however_long_the_interval(far):
    elapsed = np.array([7, 7, 7, 5, far, 7], np.int64)
    pixel = np.array([9, 2, 2, 9, 0, 3], np.int64)
    polarity = np.array([-1, 1, -1, 1, 1, -1], np.int8)
    events = PixelEvents.sorted_from(100, elapsed, pixel, polarity, polarity)
    assert events.t.tolist() == [105, 107, 107, 107, 107, 100 + far]
    assert events.pixel.tolist() == [9, 2, 2, 3, 9, 0]
    assert events.polarity.tolist() == [1, -1, 1, -1, -1, 1]
    assert events.sign.tolist() == events.polarity.tolist()
