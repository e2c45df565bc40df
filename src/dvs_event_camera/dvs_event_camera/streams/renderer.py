"""Events as pictures: net polarity of a time slice, or an exponentially decaying surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS
from dvs_event_camera.pixels.pixel_events import PixelEvents

# Blue, green, red of a full ON and a full OFF pixel; the ground is dark so that both stand out.
# Orange and blue are the pair of Okabe and Ito that every kind of colour vision separates.
PALETTES = {
    'red_blue': ((60, 60, 255), (255, 140, 40)),
    'orange_blue': ((0, 159, 230), (233, 180, 86)),
}
BACKGROUND = (24, 20, 20)
# Net polarity at which a pixel has its full colour.
_FULL = 3.0
# Least share of the full colour of a pixel with any event, so that one event can be seen.
_LEAST = 0.45
_QUIET = 0.02


class EventRenderer:
    """Collects events and draws them as `bgr8`.

    Parameters
    ----------
    height
        Rows.
    width
        Columns.
    style
        `time_slice`: net polarity since the last picture; `surface`: every event adds its
        polarity to a surface that decays exponentially.
    palette
        `red_blue` or `orange_blue`; ON first.
    decay_s
        Time constant of the surface, s.

    Raises
    ------
    ParameterError
        If style or palette is unknown.
    """

    def __init__(
        self,
        height: int,
        width: int,
        *,
        style: str = 'time_slice',
        palette: str = 'red_blue',
        decay_s: float = 0.05,
    ) -> None:
        if style not in ('time_slice', 'surface'):
            raise ParameterError('display_style', style, 'must be time_slice or surface')
        if palette not in PALETTES:
            raise ParameterError('display_palette', palette, f'must be one of {list(PALETTES)}')
        self._shape = (height, width)
        self._decays = style == 'surface'
        self._decay_ns = decay_s * NANOSECONDS
        self._surface = np.zeros(height * width)
        self._stamp_ns: int | None = None
        self._ramps = [np.array([BACKGROUND, colour], float) for colour in PALETTES[palette]]

    def add(self, events: PixelEvents, stamp_ns: int) -> None:
        """Collect events.

        Parameters
        ----------
        events
            Events up to `stamp_ns`.
        stamp_ns
            Time of the surface from now on, ns.
        """
        weights = events.polarity.astype(np.float64)
        if self._decays:
            if self._stamp_ns is not None:
                self._surface *= math.exp(min(0, self._stamp_ns - stamp_ns) / self._decay_ns)
            weights *= np.exp((events.t - stamp_ns) / self._decay_ns)
        self._stamp_ns = stamp_ns
        if len(events):
            self._surface += np.bincount(events.pixel, weights, minlength=self._surface.size)

    def draw(self) -> NDArray[np.uint8]:
        """Picture of shape (height, width, 3), blue, green, red; a time slice starts anew."""
        on, off = self._ramps
        surface = self._surface
        share = np.minimum(np.abs(surface) / _FULL, 1.0)
        seen = share > _QUIET if self._decays else share > 0
        floor = 0.0 if self._decays else _LEAST
        share = np.where(seen, floor + (1.0 - floor) * share, 0.0)[:, None]
        full = np.where((surface > 0)[:, None], on[1], off[1])
        picture: NDArray[np.uint8] = np.rint(on[0] + share * (full - on[0])).astype(np.uint8)
        if not self._decays:
            self._surface[:] = 0.0
        return picture.reshape(*self._shape, 3)
