"""Pictures of events: colours, decay, and one picture a slice."""

import math

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.renderer import BACKGROUND, PALETTES, EventRenderer


def events_at(pixels, polarities, t=0):
    size = len(pixels)
    return PixelEvents(
        t=np.full(size, t, np.int64),
        pixel=np.array(pixels, np.int32),
        polarity=np.array(polarities, np.int8),
        sign=np.ones(size, np.int8),
    )


@pytest.mark.parametrize('palette', PALETTES)
def test_full_colours_on_dark_ground(palette):
    renderer = EventRenderer(2, 3, palette=palette)
    renderer.add(events_at([0] * 3 + [4] * 5, [1] * 3 + [-1] * 5), 0)
    picture = renderer.draw()
    assert picture.shape == (2, 3, 3)
    assert picture.dtype == np.uint8
    on, off = PALETTES[palette]
    assert tuple(picture[0, 0]) == on
    assert tuple(picture[1, 1]) == off
    assert tuple(picture[0, 1]) == BACKGROUND
    assert max(BACKGROUND) < 40


def test_on_events_are_red_and_off_events_blue():
    blue, _, red = range(3)
    renderer = EventRenderer(1, 2)
    renderer.add(events_at([0, 1], [1, -1]), 0)
    picture = renderer.draw().astype(int)
    assert picture[0, 0, red] > picture[0, 0, blue] + 50
    assert picture[0, 1, blue] > picture[0, 1, red] + 50


def test_slice_starts_anew_and_surface_does_not():
    for style, lasts in (('time_slice', False), ('surface', True)):
        renderer = EventRenderer(1, 1, style=style, decay_s=1.0)
        renderer.add(events_at([0], [1]), 0)
        renderer.draw()
        assert (tuple(renderer.draw()[0, 0]) != BACKGROUND) == lasts


def test_surface_decays_from_the_events_own_time():
    renderer = EventRenderer(1, 2, style='surface', decay_s=0.1)
    second = 10**9
    renderer.add(events_at([0], [1], t=0), second // 10)
    assert renderer._surface[0] == pytest.approx(math.exp(-1))
    renderer.add(PixelEvents.empty(), second // 5)
    assert renderer._surface[0] == pytest.approx(math.exp(-2))
    renderer.add(PixelEvents.empty(), 10 * second)
    assert tuple(renderer.draw()[0, 0]) == BACKGROUND


def test_unknown_style_and_palette_are_refused():
    with pytest.raises(ParameterError, match='display_style'):
        EventRenderer(1, 1, style='3d')
    with pytest.raises(ParameterError, match='display_palette'):
        EventRenderer(1, 1, palette='pink')
