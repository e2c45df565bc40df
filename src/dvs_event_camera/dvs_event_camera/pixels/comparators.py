"""The comparators of a pixel array: levels of a tile of pixels in, events of the interval out.

An array works through a frame in tiles that fit into the processor's cache, so that a frame
without events costs one pass over memory. A comparator is told when an interval begins, is handed
the levels tile by tile, and gives the events in order at the end.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.compiled import kernels_for
from dvs_event_camera.pixels.crossings import (
    CountArray,
    RawEvents,
    hold_invalid,
    join,
    linear_crossings,
)
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.pixel_events import KEY_BITS, PixelEvents

# Pixels from which compiling (once, then cached) and importing numba pays.
_WORTH_COMPILING = 4096


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

    def begin(self, start_ns: int, duration_ns: int) -> None:
        """Start an interval.

        Parameters
        ----------
        start_ns
            Time of the last sample, ns.
        duration_ns
            Time to the new sample, ns.
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
        self._previous: FloatArray = (levels - origin) / step
        self._origin = origin
        self._step = step

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._counts

    @property
    def positions(self) -> FloatArray:
        """Levels of the last sample in steps above the first references, shape (r,)."""
        return self._previous

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray) -> None:
        """Start pixels; see `Comparator.start_pixels`."""
        self._previous[pixels] = 0.0

    def begin(self, start_ns: int, duration_ns: int) -> None:
        """Start an interval; see `Comparator.begin`."""
        self._start_ns, self._duration_ns = start_ns, duration_ns
        self._expected = 0.0
        self._parts: list[RawEvents] = []

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        levels -= self._origin[tile]
        levels /= self._step
        previous = self._previous[tile]
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


class NumbaComparator(NumpyComparator):
    """The same, compiled; intervals too long for the packed keys are left to NumPy.

    Parameters
    ----------
    levels
        Levels at the first sample, shape (r,).
    origin
        Levels of the first references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    kernels
        Module `crossings_numba`.
    """

    def __init__(self, levels: FloatArray, origin: FloatArray, step: float, kernels: Any) -> None:
        super().__init__(levels, origin, step)
        self._compiled = kernels
        self._pixel_bits = max(1, (levels.size - 1).bit_length())
        self._keys = np.empty(1024, np.int64)
        self._mask = np.zeros(0, np.uint8)
        self._found = np.zeros(0, np.int32)
        self._invalid = np.zeros(1, np.int64)

    def begin(self, start_ns: int, duration_ns: int) -> None:
        """Start an interval; see `Comparator.begin`."""
        super().begin(start_ns, duration_ns)
        self._used = 0
        self._packed = duration_ns.bit_length() + self._pixel_bits + 2 <= KEY_BITS

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `Comparator.fire`."""
        if not self._packed:
            super().fire(levels, first_pixel)
            return
        if self._mask.size < levels.size + 8:
            self._mask = np.zeros((levels.size + 15) // 8 * 8, np.uint8)
            self._found = np.zeros(self._mask.size, np.int32)
        tile = slice(first_pixel, first_pixel + levels.size)
        previous, counts = self._previous[tile], self._counts[tile]
        number = self._compiled.find_news(
            levels, self._origin[tile], counts, self._step, self._mask, self._found
        )
        found = self._found[:number]
        while found.size:
            done, self._used, needed = self._compiled.fire(
                levels,
                previous,
                counts,
                found,
                self._duration_ns,
                first_pixel,
                self._pixel_bits,
                self._keys,
                self._used,
                self._invalid,
            )
            found = found[done:]
            if found.size:
                require_bounded(needed)
                grown = np.empty(max(needed, 2 * self._keys.size), np.int64)
                grown[: self._used] = self._keys[: self._used]
                self._keys = grown
        previous[:] = levels
        self.invalid = int(self._invalid[0])

    def finish(self) -> PixelEvents:
        """Events of the interval; see `Comparator.finish`."""
        if not self._packed:
            return super().finish()
        keys = self._keys[: self._used]
        keys.sort()
        events = PixelEvents(
            t=np.empty(keys.size, np.int64),
            pixel=np.empty(keys.size, np.int32),
            polarity=np.empty(keys.size, np.int8),
            sign=np.empty(keys.size, np.int8),
        )
        self._compiled.unpack_keys(
            keys,
            self._start_ns,
            self._pixel_bits,
            events.t,
            events.pixel,
            events.polarity,
            events.sign,
        )
        return events


def ideal_comparator(
    backend: str, levels: FloatArray, origin: FloatArray, step: float
) -> NumpyComparator:
    """Comparator of ideal pixels whose level is linear in time.

    Parameters
    ----------
    backend
        `numba`, `numpy`, or `auto`: numba if it is installed and the array is large.
    levels
        Levels at the first sample, shape (r,).
    origin
        Levels of the first references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.

    Raises
    ------
    ParameterError
        If `backend` is unknown or not installed.
    """
    kernels = kernels_for(backend, levels.size, worth=_WORTH_COMPILING)
    if kernels is None:
        return NumpyComparator(levels, origin, step)
    return NumbaComparator(levels, origin, step, kernels)
