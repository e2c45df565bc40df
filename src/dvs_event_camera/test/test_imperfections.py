"""Every non-ideality against what it must do, and that off means off."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import SignedLogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents

MS = 1_000_000


def run(array, stamps, frames):
    parts = [array.update(int(t), y) for t, y in zip(stamps, frames, strict=True)]
    events = PixelEvents.empty()
    for part in parts:
        events = PixelEvents.merged(events, part)
    return events


def array_with(h=0.1, *, seed=0, label_noise=False, **imperfections):
    return PixelArray(
        event_threshold=h,
        imperfections=Imperfections(**imperfections),
        label_noise=label_noise,
        seed=seed,
    )


def net(events, size):
    return np.bincount(events.pixel, weights=events.polarity, minlength=size)


def walk(seed, count, size, scale=0.3):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, scale, (count, size)), axis=0)


def test_zero_imperfections_are_the_ideal_pixel():
    frames = np.exp(walk(0, 50, 20))
    stamps = np.arange(50) * MS
    ideal = run(PixelArray(event_threshold=0.1), stamps, frames)
    # A refractory period of nothing takes the imperfect path.
    other = run(array_with(refractory_period=1e-12), stamps, frames)
    assert np.array_equal(ideal.t, other.t)
    assert np.array_equal(ideal.pixel, other.pixel)
    assert np.array_equal(ideal.polarity, other.polarity)


@pytest.mark.ensemble
@given(st.integers(0, 1000), st.sampled_from([0.3e-3, 2e-3, 7e-3]))
@settings(max_examples=40, deadline=None)
def test_refractory_pixel_waits_and_then_fires_all_that_is_due(seed, period):
    h, size = 0.1, 5
    levels = np.vstack([np.zeros(size), walk(seed, 30, size)])
    levels = np.vstack([levels, np.repeat(levels[-1:], 400, axis=0)])
    array = array_with(h, refractory_period=period)
    events = run(array, np.arange(len(levels)) * MS, np.exp(levels))
    for pixel in range(size):
        gaps = np.diff(events.t[events.pixel == pixel])
        assert gaps.size == 0 or gaps.min() >= round(period * 1e9)
    assert np.all(np.abs(levels[-1] - net(events, size) * h) < h * (1 + 1e-9))


def test_refractory_pixel_fires_at_the_end_of_its_period_while_it_is_behind():
    array = array_with(0.1, refractory_period=2.5e-3)
    events = run(array, [0, MS, 10 * MS, 20 * MS], np.exp([[0.0], [0.35], [0.35], [0.35]]))
    first = math.ceil(0.1 / 0.35 * MS)
    assert events.t.tolist() == [first, first + 2_500_000, first + 5_000_000]


def test_refractory_pixel_whose_light_comes_back_in_time_fires_no_more():
    array = array_with(0.1, refractory_period=5e-3)
    events = run(array, [0, MS, 2 * MS, 9 * MS], np.exp([[0.0], [0.35], [0.05], [0.05]]))
    assert events.polarity.tolist() == [1]


def test_event_at_time_zero_is_not_a_pixel_that_has_never_fired():
    # ESIM takes stamp 0 for "never": a pixel that fires at 0 would not be refractory.
    array = array_with(0.1, refractory_period=5e-3)
    events = run(array, [-MS, 0, MS], np.exp([[0.0], [0.1 + 1e-12], [0.25]]))
    assert events.t.tolist() == [0]
    # And one that has never fired is not refractory at 0, nor at any other time.
    array = array_with(0.1, refractory_period=5e-3)
    assert len(run(array, [-2, -1], np.exp([[0.0], [0.15]]))) == 1


def test_mismatch_is_frozen_with_on_and_off_apart():
    size, h, spread = 4000, 0.1, 0.1
    array = array_with(h, threshold_mismatch=spread)
    up = run(array, [0, 10**9], np.exp([np.zeros(size), np.ones(size)]))
    down = array.update(2 * 10**9, np.exp(np.full(size, -1.0)))
    on = np.array([np.diff(up.t[up.pixel == i])[0] for i in range(300)]) * 1e-9
    off = np.array([np.diff(down.t[down.pixel == i])[0] for i in range(300)]) * 2e-9
    assert on.mean() == pytest.approx(h, rel=0.03)
    assert on.std() == pytest.approx(h * spread, rel=0.15)
    assert off.std() == pytest.approx(h * spread, rel=0.15)
    assert abs(np.corrcoef(on, off)[0, 1]) < 0.2
    again = [np.diff(up.t[up.pixel == i])[2] for i in range(300)]
    assert np.allclose(np.array(again) * 1e-9, on, atol=3e-9)


def test_mismatched_pixel_never_dies_on_a_ramp():
    # ESIM redraws a noisy threshold so that the new reference can lie beyond the next sample.
    size, h = 500, 0.1
    array = array_with(h, threshold_mismatch=0.5, seed=5)
    levels = np.linspace(0, 2, 200)[:, None] * np.ones(size)
    events = run(array, np.arange(200) * MS, np.exp(levels))
    theta = array.engine.comparator.state.on_thresholds
    counts = net(events, size)
    assert np.array_equal(counts, array.counts)
    assert np.all(np.abs(2.0 - counts * theta) < theta * (1 + 1e-9))


def test_leak_makes_on_events_at_its_rate_in_constant_light():
    size, rate, seconds = 500, 2.0, 10
    array = array_with(leak_rate=rate, label_noise=True)
    events = run(array, np.arange(0, seconds * 100 + 1) * 10 * MS, np.ones((1001, size)))
    assert np.all(events.polarity == 1)
    assert np.all(np.abs(net(events, size) - rate * seconds) <= 1)
    for pixel in range(5):
        assert np.allclose(np.diff(events.t[events.pixel == pixel]), 5e8, atol=2)
    assert np.all(events.noise == 1)


def test_hot_pixels_fire_and_dead_ones_do_not():
    size = 1000
    array = array_with(
        hot_pixel_fraction=0.01, hot_pixel_rate=50.0, dead_pixel_fraction=0.02, label_noise=True
    )
    still = run(array, np.arange(101) * 10 * MS, np.ones((101, size)))
    assert np.unique(still.pixel).size == 10
    assert np.bincount(still.pixel)[np.unique(still.pixel)] == pytest.approx(50, abs=1)
    assert still.noise.min() == 1
    moved = array.update(1010 * MS, np.full(size, math.exp(0.55)))
    assert size - np.unique(moved.pixel).size == 20


def test_shot_noise_is_poisson_balanced_and_repaired():
    size, rate, seconds, h = 2000, 1.0, 5, 0.1
    array = array_with(h, shot_noise_rate=rate, label_noise=True)
    events = run(array, np.arange(seconds * 20 + 1) * 50 * MS, np.ones((101, size)))
    assert events.noise.min() == 1
    # Every pixel sits on its reference, so each spurious event is a whole step off: it is undone
    # at once, a nanosecond later.
    assert np.all(np.abs(array.counts) <= 1)
    assert len(events) / (2 * size * seconds) == pytest.approx(rate, rel=0.03)
    on = np.count_nonzero(events.polarity > 0)
    assert on / len(events) == pytest.approx(0.5, abs=0.01)
    one = events.take(np.flatnonzero(events.pixel == 7))
    assert np.all(np.diff(one.t)[::2] == 1)


def test_polarity_of_shot_noise_is_even_where_it_is_not_undone():
    size = 5000
    array = array_with(50.0, shot_noise_rate=3.0)
    array.update(0, np.ones(size))
    events = array.update(10**9, np.ones(size))
    first = events.take(np.unique(events.pixel, return_index=True)[1])
    assert np.mean(first.polarity) == pytest.approx(0.0, abs=0.05)


def test_thresholds_of_on_and_off_are_apart():
    array = array_with(0.1, event_threshold_off=0.25)
    events = run(array, [0, MS, 2 * MS], np.exp([[0.0], [1.05], [0.05]]))
    assert events.polarity.tolist() == [1] * 10 + [-1] * 3
    # From a reference of 1.0 the level falls by 0.25 a time.
    expected = MS + (1.05 - (1.0 - 0.25 * np.arange(1, 4))) * MS
    assert np.allclose(events.t[10:], expected, atol=2)


def test_physical_reset_takes_the_present_level_and_fires_no_more():
    frames = np.exp([[0.0], [0.35], [0.35], [0.35], [0.44], [0.46]])
    stamps = [0, MS, 10 * MS, 20 * MS, 21 * MS, 22 * MS]
    ladder, level = (
        run(array_with(0.1, refractory_period=2.5e-3, reset=reset), stamps, frames)
        for reset in ('ladder', 'level')
    )
    assert len(ladder) == 4
    # The second event comes at the end of the pause and settles all that was missed: 0.35.
    first = math.ceil(0.1 / 0.35 * MS)
    assert level.t.tolist()[:2] == [first, first + 2_500_000]
    assert level.t[2:].tolist() == [pytest.approx(21.5 * MS, abs=2)]


def test_spurious_event_of_a_physical_reset_is_not_undone():
    size, h = 2000, 0.1
    array = array_with(h, shot_noise_rate=5.0, reset='level', label_noise=True)
    events = run(array, np.arange(11) * 100 * MS, np.ones((11, size)))
    assert len(events) / (size * 5.0) == pytest.approx(1.0, rel=0.03)
    assert np.all(events.noise == 1)
    # The sums walk at random, and the next event comes a whole threshold from the present level.
    assert np.var(net(events, size)) == pytest.approx(5.0, rel=0.1)
    moved = array.update(2000 * MS, np.full(size, math.exp(0.15)))
    assert np.count_nonzero(moved.noise == 0) > 0.9 * size * math.exp(-5.0)


def test_leak_of_a_physical_reset_is_labelled_and_signal_is_not():
    size, rate = 300, 2.0
    array = array_with(leak_rate=rate, reset='level', label_noise=True)
    still = run(array, np.arange(0, 1001) * 10 * MS, np.ones((1001, size)))
    assert np.mean(still.noise) > 0.99
    assert len(still) == pytest.approx(rate * 10 * size, rel=0.06)
    moved = array.update(10_001 * MS, np.full(size, math.exp(0.95)))
    assert np.mean(moved.noise) < 0.12


@pytest.mark.parametrize('backend', ['numpy', 'numba'])
def test_shot_noise_falls_to_a_quarter_in_bright_light(backend):
    if backend == 'numba':
        pytest.importorskip('numba')
    size = 6000
    wanted = Imperfections(shot_noise_rate=10.0, shot_noise_luminosity=100.0, reset='level')
    array = PixelArray(event_threshold=0.1, imperfections=wanted, backend=backend)
    light = np.repeat([1e-3, 50.0, 100.0, 1000.0], size // 4)
    array.update(0, light)
    pixel = array.update(10**9, light).pixel
    found = np.bincount(pixel // (size // 4), minlength=4) / (size // 4)
    assert found == pytest.approx([10.0, 6.25, 2.5, 2.5], rel=0.08)


@pytest.mark.ensemble
@given(st.integers(0, 1000))
@settings(max_examples=15, deadline=None)
def test_events_not_labelled_as_noise_add_up_to_the_true_change(seed):
    size, h = 6, 0.1
    levels = np.vstack([np.zeros(size), np.clip(walk(seed, 200, size, 0.05), -2, 2)])
    array = array_with(h, leak_rate=20.0, shot_noise_rate=20.0, label_noise=True, seed=seed)
    events = run(array, np.arange(201) * 5 * MS, np.exp(levels))
    signal = events.take(np.flatnonzero(events.noise == 0))
    owed = array._labels.owed  # leakage that has silenced OFF events instead of making ON events
    assert np.all(np.abs(levels[-1] - (net(signal, size) - owed) * h) < 2.0001 * h)
    # All events together have drifted away with the leak.
    assert np.all(np.abs(levels[-1] + 20 * h - net(events, size) * h) < 2.1 * h)


def test_latency_delays_and_jitter_spreads_but_nothing_is_lost():
    size = 3000
    frames = np.exp([np.zeros(size), np.full(size, 0.25)] + [np.full(size, 0.25)] * 20)
    stamps = np.arange(22) * MS
    ideal = run(PixelArray(event_threshold=0.1), stamps, frames)
    late = run(array_with(latency=2.3e-3), stamps, frames)
    assert np.array_equal(late.t, ideal.t + 2_300_000)
    assert np.array_equal(late.pixel, ideal.pixel)
    array = array_with(latency=2.3e-3, jitter=0.2e-3)
    parts = [array.update(int(t), y) for t, y in zip(stamps, frames, strict=True)]
    for t, part in zip(stamps, parts, strict=True):
        assert np.all((part.t <= t) & (part.t > t - MS))
        assert np.all(np.diff(part.t) >= 0)
    pixel = np.concatenate([part.pixel for part in parts])
    assert np.array_equal(np.bincount(pixel), np.full(size, 2))
    delay = np.concatenate([part.t for part in parts]).sum() - ideal.t.sum()
    assert delay / len(ideal) == pytest.approx(2.3e6, rel=0.01)


def test_no_event_comes_before_its_cause():
    frames = np.exp([np.zeros(2000), np.full(2000, 0.15)] + [np.full(2000, 0.15)] * 20)
    events = run(array_with(jitter=2e-3), np.arange(22) * MS, frames)
    cause = math.ceil(0.1 / 0.15 * MS)
    assert len(events) == 2000
    assert events.t.min() == cause
    assert np.mean(events.t > cause) == pytest.approx(0.5, abs=0.05)


def test_event_due_at_the_sample_itself_is_given_out_with_it():
    array = array_with(latency=1e-3)
    array.update(0, [1.0])
    array.update(2 * MS, [math.exp(0.2)])  # crossings at 1 and 2 ms
    assert array.update(3 * MS, [math.exp(0.2)]).t.tolist() == [3 * MS]


def test_counts_are_those_of_the_events_given_out():
    array = array_with(latency=2.5e-3)
    total = np.zeros(3)
    for k, level in enumerate(walk(3, 40, 3)):
        events = array.update(k * MS, np.exp(level))
        total += net(events, 3)
        assert np.array_equal(array.counts, total)


def test_low_pass_of_an_exponential_lags_by_its_time_constant():
    cutoff, rate = 50.0, 4.0
    tau = 1 / (2 * math.pi * cutoff)
    array = array_with(0.05, cutoff_frequency=cutoff)
    stamps = np.arange(0, 501) * MS
    events = run(array, stamps, np.exp(rate * stamps * 1e-9)[:, None])
    t = events.t * 1e-9
    filtered = rate * (t - tau * (1 - np.exp(-t / tau)))
    # Linear interpolation of the filtered level bounds the error.
    assert np.allclose(filtered, 0.05 * np.arange(1, t.size + 1), atol=1e-3)
    assert np.allclose(filtered[5:], 0.05 * np.arange(6, t.size + 1), atol=1e-6)


def test_low_pass_is_slower_in_dim_light():
    array = array_with(0.05, cutoff_frequency=20.0, cutoff_luminosity=100.0)
    stamps = np.arange(0, 301) * MS
    step = np.where(stamps[:, None] > 0, math.exp(0.5), 1.0) * np.array([[200.0, 20.0, 1.0]])
    events = run(array, stamps, step)
    half = [events.t[events.pixel == i][4] for i in range(3)]
    tau = 1 / (2 * math.pi * 20.0)
    expected = [tau, tau / (0.2 * math.exp(0.5)), tau / 0.1]
    # The step takes one sampling period, so it comes half a period late.
    assert np.allclose(np.array(half) * 1e-9 - 5e-4, np.array(expected) * math.log(2), rtol=0.01)


def test_an_invalid_luminosity_does_not_enter_the_low_pass():
    array = array_with(0.05, cutoff_frequency=20.0)
    run(array, [0, MS, 2 * MS], [[1.0], [np.nan], [1.0]])
    assert array.invalid_samples == 1
    assert len(array.update(3 * MS, [1.0])) == 0
    assert len(array.update(1000 * MS, [2.0])) > 0


def test_everything_is_reproducible_and_follows_the_seed():
    def everything(seed):
        array = array_with(
            seed=seed,
            threshold_mismatch=0.1,
            refractory_period=1e-3,
            leak_rate=1.0,
            shot_noise_rate=5.0,
            cutoff_frequency=200.0,
            hot_pixel_fraction=0.05,
            dead_pixel_fraction=0.05,
            latency=1e-3,
            jitter=1e-4,
            label_noise=True,
        )
        return run(array, np.arange(40) * MS, np.exp(walk(1, 40, 100)))

    one, same, other = everything(1), everything(1), everything(2)
    for field in ('t', 'pixel', 'polarity', 'sign', 'noise'):
        assert np.array_equal(getattr(one, field), getattr(same, field))
    assert not np.array_equal(one.t, other.t)


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('leak_rate', -1.0),
        ('dead_pixel_fraction', 1.5),
        ('jitter', math.nan),
        ('reset', 'often'),
    ],
)
def test_ranges_are_checked(field, value):
    with pytest.raises(ParameterError, match=field):
        Imperfections(**{field: value})


def test_combinations_without_meaning_are_refused():
    with pytest.raises(ParameterError, match='signed_log'):
        PixelArray(
            event_threshold=0.1,
            photoreceptor=SignedLogPhotoreceptor(),
            imperfections=Imperfections(jitter=1e-3),
        )
    with pytest.raises(ParameterError, match='interpolation'):
        PixelArray(
            event_threshold=0.1,
            interpolation='hermite',
            imperfections=Imperfections(refractory_period=1e-3),
        )
