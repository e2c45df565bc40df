"""Pixels that anchors contradict again and again are masked, and may come back."""

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_hinf_controller.running.pixel_health import PixelHealth

PIXELS = 3


def test_a_pixel_contradicted_again_and_again_is_masked_and_may_come_back():
    health = PixelHealth(PIXELS)
    bad, good = np.array([True, False, False]), np.array([False, True, True])
    changes = [health.note(good, bad) for _ in range(4)]
    assert changes == [False, False, False, True]
    assert health.healthy.tolist() == [False, True, True]
    assert health.read_masked() == (0,)

    everything = np.ones(PIXELS, bool)
    agreed = 0
    while not health.note(everything, ~everything):
        agreed += 1
    assert agreed == 31
    assert health.healthy.all()


def test_a_contradiction_now_and_then_masks_nothing():
    health = PixelHealth(PIXELS)
    everything = np.ones(PIXELS, bool)
    for k in range(200):
        bad = everything & (k % 10 == 0)
        assert not health.note(~bad, bad)
    assert health.healthy.all()


def test_where_all_pixels_are_suspect_none_is_masked_but_those_that_were_given():
    health = PixelHealth(PIXELS, (1,))
    assert health.healthy.tolist() == [True, False, True]
    everything = np.ones(PIXELS, bool)
    for _ in range(10):
        health.note(~everything, everything)
    assert health.healthy.tolist() == [True, False, True]


@pytest.mark.parametrize(('mask', 'rule'), [((3,), '0 to 2'), ((0, 1, 2), 'must leave a pixel')])
def test_a_mask_that_fits_no_array_is_refused(mask, rule):
    with pytest.raises(ParameterError, match=rule):
        PixelHealth(PIXELS, mask)
