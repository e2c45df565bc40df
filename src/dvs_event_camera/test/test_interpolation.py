"""Stamps against closed forms, with both interpolations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.hermite import end_slopes, monotone_cubic_root
from dvs_event_camera.pixels.pixel_array import PixelArray

TAU = 0.05


def saturating(t):
    """Luminosity on its way from 0.2 to 1 with a time constant of 50 ms."""
    return 1.0 - 0.8 * np.exp(-t / TAU)


def worst_error(period_ns, interpolation, *, skip=0):
    h = 0.1
    array = PixelArray(event_threshold=h, interpolation=interpolation)
    found = [
        array.update(k * period_ns, [saturating(k * period_ns * 1e-9)]).t
        for k in range(int(0.25e9 / period_ns))
    ]
    stamps = np.concatenate(found) * 1e-9
    expected = -TAU * np.log((1 - 0.2 * np.exp(h * np.arange(1, stamps.size + 1))) / 0.8)
    assert stamps.size == 16
    return np.abs(stamps - expected)[skip:].max()


def test_cubic_brings_a_sampled_exponential_under_100_ns():
    # A cubic takes four samples: the first event lies within the first three intervals.
    linear, cubic = (worst_error(1_000_000, k, skip=1) for k in ('linear_log', 'hermite'))
    assert 1e-6 < linear < 2e-5
    assert cubic < 1e-7


def test_error_falls_with_the_second_and_the_fourth_power_of_the_period():
    linear = [worst_error(ns, 'linear_log', skip=4) for ns in (2_000_000, 1_000_000)]
    cubic = [worst_error(ns, 'hermite', skip=4) for ns in (4_000_000, 2_000_000)]
    assert 3 < linear[0] / linear[1] < 5.5
    assert cubic[0] / cubic[1] > 8


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.integers(1, 10**7)), min_size=1, max_size=12),
    st.floats(0.02, 0.5),
)
@settings(max_examples=200, deadline=None)
def test_cubic_changes_stamps_but_never_counts(samples, h):
    arrays = [PixelArray(event_threshold=h, interpolation=k) for k in ('linear_log', 'hermite')]
    for array in arrays:
        array.update(0, [1.0])
    now = 0
    for level, period in samples:
        linear, cubic = (array.update(now + period, [math.exp(level)]) for array in arrays)
        assert linear.polarity.tolist() == cubic.polarity.tolist()
        assert np.all((cubic.t > now) & (cubic.t <= now + period))
        assert np.all(np.diff(cubic.t) >= 0)
        now += period
    assert arrays[0].counts == arrays[1].counts


def test_cubic_copes_with_steps_in_the_stamps():
    array = PixelArray(event_threshold=0.1, interpolation='hermite')
    array.update(0, [saturating(0.0)])
    rng = np.random.default_rng(0)
    now, found = 0, []
    while now < 150_000_000:
        now += int(rng.choice([300_000, 700_000, 1_000_000]))
        found.append(array.update(now, [saturating(now * 1e-9)]).t)
    stamps = np.concatenate(found) * 1e-9
    expected = -TAU * np.log((1 - 0.2 * np.exp(0.1 * np.arange(1, stamps.size + 1))) / 0.8)
    assert np.abs(stamps - expected)[1:].max() < 1e-7


def test_unknown_interpolation_is_refused():
    with pytest.raises(ParameterError, match='interpolation'):
        PixelArray(event_threshold=0.1, interpolation='spline')


@given(
    st.lists(st.floats(-5, 5), min_size=4, max_size=4),
    st.lists(st.integers(1, 100), min_size=3, max_size=3),
)
@settings(max_examples=200, deadline=None)
def test_cubic_between_two_samples_is_monotone(samples, durations):
    oldest, older, start, end = (np.array([v]) for v in samples)
    if abs(end[0] - start[0]) < 1e-6:
        return
    slope0, slope1 = end_slopes(start, end, older, oldest, durations)
    rise = end - start
    for slope in (slope0, slope1):
        assert 0 <= slope[0] / rise[0] <= 3 + 1e-12
    share = np.linspace(0, 1, 101)
    columns = [np.full(share.size, value[0]) for value in (rise, slope0, slope1)]
    root = monotone_cubic_root(*columns, share * rise[0])
    # Where the cubic is flat, rounding moves a root by the cube root of the resolution.
    assert np.all(np.diff(root) >= -1e-5)
    # It is a root: the cubic there has the value that was asked for.
    d0, d1 = slope0[0] / rise[0], slope1[0] / rise[0]
    value = root * d0 + root**2 * (3 - 2 * d0 - d1) + root**3 * (d0 + d1 - 2)
    assert np.allclose(value, share, atol=1e-9)
