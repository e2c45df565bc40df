"""Crossings of the signed-log pixel, whose luminosity may change sign (no real sensor).

The reference is ``s |q|`` with a sign s. When the luminosity leaves the silent band on the other
side, the pixel fires two events at that instant with one stamp: OFF with the old sign (the
reference steps down through zero), ON with the new sign (and up again on the other side). The
polarities cancel, so ``|q|`` is unchanged, and every event carries the sign of its reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.crossings import (
    NO_EVENTS,
    CountArray,
    RawEvents,
    hold_invalid,
    join,
    ladder,
    quantise,
    stamp,
)
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.pixel_events import PixelEvents

SignArray = NDArray[np.int8]


def signed_log_crossings(
    previous: FloatArray,
    current: FloatArray,
    origin: FloatArray,
    counts: CountArray,
    signs: SignArray,
    *,
    band: float,
    step: float,
    duration_ns: int,
) -> RawEvents:
    """Events of one interval; `counts` and `signs` move with them.

    Between samples the logarithm of the luminosity is linear in time, except where the luminosity
    changes sign or touches the band: there the luminosity itself is, since a logarithm has no
    meaning across zero.

    Parameters
    ----------
    previous
        Luminosity at the start of the interval, of either sign, shape (r,).
    current
        Luminosity at its end, finite, shape (r,).
    origin
        Logarithm of the first reference's magnitude, shape (r,).
    counts
        N, shape (r,); updated in place.
    signs
        s, shape (r,); updated in place.
    band
        Half-width of the silent band.
    step
        Threshold as a change of the logarithm, ``h ln b``.
    duration_ns
        Length of the interval, ns.
    """
    v1 = (np.log(np.maximum(np.abs(current), band)) - origin) / step
    require_bounded(float(np.floor(np.abs(v1 - counts)).sum()), float(np.abs(v1).max()))
    flips = (np.abs(current) >= band) & (np.where(current < 0, -1, 1) != signs)
    index = np.flatnonzero(flips | (v1 >= counts + 1.0) | (v1 <= counts - 1.0))
    if not index.size:
        return NO_EVENTS
    leg = _Interval(previous[index], current[index], origin[index], band, step, duration_ns)
    flips, before, old_signs = flips[index], counts[index], signs[index]
    # A pixel that flips goes down to the edge of the band first, and up again on the other side.
    edge = np.where(flips, leg.v_band, before)
    require_bounded(float(np.floor(np.abs(edge - before)).sum()), float(np.abs(edge).max()))
    lowest = quantise(edge, before)
    after = quantise(v1[index], lowest)
    new_signs = np.where(flips, -old_signs, old_signs).astype(np.int8)
    parts = [
        leg.climb(before, lowest, old_signs, index),
        leg.flip(np.flatnonzero(flips), old_signs, index),
        leg.climb(lowest, after, new_signs, index),
    ]
    counts[index] = after
    signs[index] = new_signs
    return join(parts)


class _Interval:
    """The interpolated luminosity of the pixels that fire in one interval."""

    def __init__(
        self,
        y0: FloatArray,
        y1: FloatArray,
        origin: FloatArray,
        band: float,
        step: float,
        duration_ns: int,
    ) -> None:
        self._y0, self._y1, self._origin = y0, y1, origin
        self._band, self._step, self._duration_ns = band, step, duration_ns
        self._linear = (y0 * y1 <= 0) | (np.abs(y0) < band) | (np.abs(y1) < band)
        self.v_band: FloatArray = (np.log(band) - origin) / step

    def climb(
        self, before: CountArray, after: CountArray, signs: SignArray, index: NDArray[np.int64]
    ) -> RawEvents:
        """Events from one count to another with the luminosity on the side of `signs`."""
        owner, polarity, threshold = ladder(before, after)
        magnitude = np.exp(self._origin[owner] + threshold * self._step)
        return RawEvents(
            self._stamps(owner, magnitude, signs[owner]),
            index[owner],
            polarity,
            signs[owner],
        )

    def flip(
        self, owner: NDArray[np.int64], old_signs: SignArray, index: NDArray[np.int64]
    ) -> RawEvents:
        """The pair of events with which each pixel of `owner` changes sign."""
        elapsed = self._stamps(owner, np.full(owner.size, self._band), -old_signs[owner])
        signs = old_signs[owner]
        return RawEvents(
            np.concatenate([elapsed, elapsed]),
            np.concatenate([index[owner], index[owner]]),
            np.repeat(np.array([-1, 1], np.int8), owner.size),
            np.concatenate([signs, -signs]),
        )

    def _stamps(
        self, owner: NDArray[np.int64], magnitude: FloatArray, signs: SignArray
    ) -> NDArray[np.int64]:
        """When the luminosity reaches ``signs * magnitude``, ns from the start."""
        y0, y1 = self._y0[owner], self._y1[owner]
        linear = (signs * magnitude - y0) / np.where(y1 == y0, 1.0, y1 - y0)
        l0, l1 = (np.log(np.maximum(np.abs(y), self._band)) for y in (y0, y1))
        logarithmic = (np.log(magnitude) - l0) / np.where(l1 == l0, 1.0, l1 - l0)
        fraction = np.where(self._linear[owner], linear, logarithmic)
        return stamp(fraction * self._duration_ns, self._duration_ns)


class SignedComparator:
    """Signed-log pixels as a `comparators.Comparator`; takes luminosities in place of levels.

    Parameters
    ----------
    luminosity
        First sample, shape (r,).
    origin
        Logarithm of the first references' magnitudes, shape (r,).
    step
        Threshold as a change of the logarithm, ``h ln b``.
    band
        Half-width of the silent band.
    """

    def __init__(
        self, luminosity: FloatArray, origin: FloatArray, step: float, band: float
    ) -> None:
        self._counts: CountArray = np.zeros(luminosity.size, np.int32)
        self.signs: SignArray = np.where(luminosity < 0, -1, 1).astype(np.int8)
        self.invalid = 0
        self._previous = luminosity.copy()
        self._origin, self._step, self._band = origin, step, band

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._counts

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray) -> None:
        """Start pixels; see `comparators.Comparator.start_pixels`."""
        self._previous[pixels] = levels
        self.signs[pixels] = np.where(levels < 0, -1, 1)

    def begin(self, start_ns: int, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Start an interval; see `comparators.Comparator.begin`."""
        self._start_ns, self._duration_ns = start_ns, duration_ns
        self._parts: list[RawEvents] = []

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare luminosities; see `comparators.Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        previous = self._previous[tile]
        current = levels.copy()
        self.invalid += hold_invalid(current, previous)
        events = signed_log_crossings(
            previous,
            current,
            self._origin[tile],
            self._counts[tile],
            self.signs[tile],
            band=self._band,
            step=self._step,
            duration_ns=self._duration_ns,
        )
        previous[:] = current
        if events.elapsed.size:
            self._parts.append(events._replace(pixel=events.pixel + first_pixel))

    def finish(self) -> PixelEvents:
        """Events of the interval; see `comparators.Comparator.finish`."""
        if not self._parts:
            return PixelEvents.empty()
        return join(self._parts).in_order(self._start_ns)
