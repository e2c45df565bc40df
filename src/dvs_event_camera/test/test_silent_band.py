"""Small arrays leave silent frames for later, without any visible difference."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.arrays import FEW_FLOATS
from dvs_event_camera.pixels.photoreceptor import LogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.silent_band import SilentBand

MS = 1_000_000
SMALL = 3
luminosities = st.one_of(st.floats(0.8, 1.25), st.sampled_from([0.0, -1.0, math.nan, 1e-300, 1e9]))
frames = st.lists(
    st.lists(luminosities, min_size=SMALL, max_size=SMALL), min_size=1, max_size=20
).map(np.array)


@pytest.mark.ensemble
@given(frames, st.floats(0.01, 0.3), st.sampled_from([0.0, 0.9]), st.integers(0, 19))
@settings(max_examples=100, deadline=None)
def test_a_small_array_fires_as_the_same_pixels_of_a_large_one_do(frames, h, floor, change_at):
    copies = FEW_FLOATS // SMALL + 1
    receptor = LogPhotoreceptor(log_floor=floor)
    small, large = (PixelArray(event_threshold=h, photoreceptor=receptor) for _ in range(2))
    small.update(0, np.ones(SMALL))
    large.update(0, np.ones(SMALL * copies))
    for k, frame in enumerate(frames, start=1):
        if k == change_at:
            small.change_event_threshold(0.7 * h)
            large.change_event_threshold(0.7 * h)
        found, expected = small.update(k * MS, frame), large.update(k * MS, np.tile(frame, copies))
        expected = expected.take(np.flatnonzero(expected.pixel < SMALL))
        for column in ('t', 'pixel', 'polarity', 'sign'):
            assert np.array_equal(getattr(found, column), getattr(expected, column))
        assert np.array_equal(small.counts, large.counts[:SMALL])
        assert small.invalid_samples * copies == large.invalid_samples


@pytest.mark.parametrize('level', [-300.0, 0.0, 3.0, 300.0])
@pytest.mark.parametrize('step', [1e-6, 0.15, 2.0])
def test_the_band_ends_just_inside_the_thresholds(level, step):
    band = SilentBand(np.array([level]), step)

    for side in (-1, 1):
        assert band.holds([math.exp(level + side * 0.99 * step)])
        assert not band.holds([math.exp(level + side * step)])


@pytest.mark.parametrize('y', [0.0, -1.0, math.nan, math.inf])
def test_what_has_no_logarithm_is_never_silent(y):
    assert not SilentBand(np.array([0.0, 0.0]), 0.15).holds([1.0, y])


def test_thresholds_below_the_resolution_of_numbers_leave_no_band():
    assert not SilentBand(np.array([0.0]), 1e-12).holds([1.0])
    assert not SilentBand(np.array([709.0]), 2.0).holds([math.exp(709.0)])
