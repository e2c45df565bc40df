"""Images cropped and binned as events are, and pixels that are masked."""

import numpy as np
import pytest

from dvs_common.wire.cdr import MessageError
from dvs_event_camera.streams.frame_map import FrameMap
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_event_camera.streams.pixel_map import PixelMap


def frame(pixels):
    return LuminosityFrame(stamp_ns=0, pixels=np.asarray(pixels), darkest=0.0)


def test_no_map_gives_the_frame_itself():
    whole = frame(np.ones((4, 5)))

    assert FrameMap(PixelMap()).mapped(whole) is whole


def test_a_region_is_cut_out():
    pixels = np.arange(48, dtype=np.uint8).reshape(6, 8)

    found = FrameMap(PixelMap(region=(2, 1, 3, 4))).mapped(frame(pixels)).pixels

    assert found.dtype == np.uint8
    assert np.array_equal(found, pixels[1:5, 2:5])


def test_bins_are_means_of_what_is_not_masked():
    pixels = np.arange(48.0).reshape(6, 8)
    pixels[1, 2] = np.nan  # a broken one, which is masked
    pixel_map = PixelMap(region=(2, 1, 5, 4), binning=2, masked=(2, 1, 4, 1, 5, 1, 4, 2, 5, 2))

    mapping = FrameMap(pixel_map)
    found = mapping.mapped(frame(pixels)).pixels

    assert found.shape == (2, 2)
    assert found[0, 0] == np.mean([pixels[1, 3], pixels[2, 2], pixels[2, 3]])
    assert found[1, 1] == pixels[3:5, 4:6].mean()
    # All of its pixels are masked: it keeps what it saw first.
    first = pixels[1:3, 4:6].mean()
    assert found[0, 1] == first
    assert mapping.mapped(frame(pixels * 3)).pixels[0, 1] == first


def test_a_region_beyond_the_image_is_refused():
    with pytest.raises(MessageError, match='beyond the 5 x 4 pixels'):
        FrameMap(PixelMap(region=(2, 1, 5, 4))).mapped(frame(np.ones((4, 5))))
