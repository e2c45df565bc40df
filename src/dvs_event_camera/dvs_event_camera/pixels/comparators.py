"""The comparators of a pixel array: levels of a tile of pixels in, events of the interval out.

An array works through a frame in tiles that fit into the processor's cache, so that a frame
without events costs one pass over memory. A comparator is called when an interval begins, gets
the levels tile by tile, and gives the events in order at the end.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.crossings import (
    CountArray,
    RawEvents,
    hold_invalid,
    join,
    linear_crossings,
)
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.pixel_events import PixelEvents


class Comparator(Protocol):
    """What a pixel array asks of its comparators."""

    signs: NDArray[np.int8]
    invalid: int

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray) -> None:
        """Start pixels that had no light before, at rest on their references.

        Parameters
        ----------
        pixels
            Pixels, shape (k,); the array has set their first references already.
        levels
            Their levels, or luminosities where the comparator takes those, shape (k,).
        """

    def begin(self, start_ns: int, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Start an interval.

        Parameters
        ----------
        start_ns
            Time of the last sample, ns.
        duration_ns
            Time to the new sample, ns.
        luminosity
            The new sample, shape (r,).
        """

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile.

        Parameters
        ----------
        levels
            Levels at the end of the interval, shape (k,); may be overwritten.
        first_pixel
            Index of the tile's first pixel.

        Raises
        ------
        EventFlood
            If the interval has too many events; the comparators are of no use any more.
        """

    def finish(self) -> PixelEvents:
        """Events of the interval in order."""


class NumpyComparator:
    """Ideal pixels, level linear in time, in NumPy.

    Parameters
    ----------
    levels
        Levels at the first sample, shape (r,).
    origin
        Levels of the first references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    """

    def __init__(self, levels: FloatArray, origin: FloatArray, step: float) -> None:
        self._counts: CountArray = np.zeros(levels.size, np.int32)
        self.signs: NDArray[np.int8] = np.broadcast_to(np.int8(1), levels.size)
        self.invalid = 0
        self.previous: FloatArray = (levels - origin) / step
        self.origin = origin
        self.step = step

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._counts

    def distances(self) -> FloatArray:
        """How far the last levels lie above their references, shape (r,)."""
        return (self.previous - self._counts) * self.step

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray) -> None:
        """Start pixels; see `Comparator.start_pixels`."""
        self.previous[pixels] = 0.0

    def begin(self, start_ns: int, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Start an interval; see `Comparator.begin`."""
        self._start_ns, self._duration_ns = start_ns, duration_ns
        self._expected = 0.0
        self._parts: list[RawEvents] = []

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        levels -= self.origin[tile]
        levels /= self.step
        previous = self.previous[tile]
        if not self._is_quiet(levels, self._counts[tile]):
            self.invalid += hold_invalid(levels, previous)
            self._expect(levels, self._counts[tile])
            events = self._crossings(previous, levels, first_pixel)
            if events.elapsed.size:
                self._parts.append(events)
        previous[:] = levels

    def _is_quiet(self, levels: FloatArray, counts: CountArray) -> bool:
        """Whether all levels are valid and none has moved by a threshold."""
        return bool(np.maximum.reduce(np.abs(levels - counts)) < 1.0)

    def _expect(self, levels: FloatArray, counts: CountArray) -> None:
        self._expected += float(np.floor(np.abs(levels - counts)).sum())
        require_bounded(self._expected, float(np.abs(levels).max()))

    def _crossings(self, previous: FloatArray, current: FloatArray, first_pixel: int) -> RawEvents:
        return linear_crossings(
            previous,
            current,
            self._counts[first_pixel : first_pixel + current.size],
            duration_ns=self._duration_ns,
            first_pixel=first_pixel,
        )

    def finish(self) -> PixelEvents:
        """Events of the interval; see `Comparator.finish`."""
        if not self._parts:
            return PixelEvents.empty()
        return join(self._parts).in_order(self._start_ns)
