"""Crossing instants from a cubic through neighbouring samples, for ideal pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.comparators import NumpyComparator
from dvs_event_camera.pixels.crossings import NO_EVENTS, RawEvents, ladder, quantise, stamp

ITERATIONS = 60


class HermiteComparator(NumpyComparator):
    """Ideal pixels, level a monotone cubic between samples.

    The slopes at both ends are those of the cubic through the last four samples (three or two
    after the start), so nothing waits for a later sample, and the error of a stamp falls with the
    fourth power of the sampling period instead of the second. Slopes are limited so that the level
    stays monotone between samples (Fritsch, Carlson: *Monotone Piecewise Cubic Interpolation*,
    SIAM J. Numer. Anal. 17 (1980)): stamps change, counts and polarities never do.

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
        super().__init__(levels, origin, step)
        self._older = self.previous.copy()
        self._oldest = self.previous.copy()
        self._durations: list[int] = []

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray) -> None:
        """Start pixels; see `comparators.Comparator.start_pixels`."""
        super().start_pixels(pixels, levels)
        self._older[pixels] = self._oldest[pixels] = 0.0

    def begin(self, start_ns: int, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Start an interval; see `comparators.Comparator.begin`."""
        super().begin(start_ns, duration_ns, luminosity)
        self._durations = [duration_ns, *self._durations[:2]]

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `comparators.Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        previous = self.previous[tile].copy()
        super().fire(levels, first_pixel)
        self._oldest[tile] = self._older[tile]
        self._older[tile] = previous

    def _crossings(self, previous: FloatArray, current: FloatArray, first_pixel: int) -> RawEvents:
        tile = slice(first_pixel, first_pixel + current.size)
        counts, older, oldest = self._counts[tile], self._older[tile], self._oldest[tile]
        index = np.flatnonzero((current >= counts + 1.0) | (current <= counts - 1.0))
        events = NO_EVENTS
        if index.size:
            start, end, before = previous[index], current[index], counts[index]
            after = quantise(end, before)
            counts[index] = after
            owner, polarity, threshold = ladder(before, after)
            slopes = end_slopes(start, end, older[index], oldest[index], self._durations)
            fraction = monotone_cubic_root(
                (end - start)[owner],
                slopes[0][owner],
                slopes[1][owner],
                threshold - start[owner],
                tolerance=tolerance_of(self._duration_ns),
            )
            events = RawEvents(
                stamp(fraction * self._duration_ns, self._duration_ns),
                index[owner] + first_pixel,
                polarity,
                np.ones(owner.size, np.int8),
            )
        return events


def end_slopes(
    start: FloatArray,
    end: FloatArray,
    older: FloatArray,
    oldest: FloatArray,
    durations: list[int],
) -> tuple[FloatArray, FloatArray]:
    """Slopes at both ends of the last interval, per interval, limited to keep it monotone.

    Parameters
    ----------
    start
        Samples at the start of the interval, shape (k,).
    end
        Samples at its end, shape (k,).
    older
        Samples before `start`, shape (k,).
    oldest
        Samples before `older`, shape (k,).
    durations
        Lengths of the intervals, the last one first; as many as there are known.
    """
    rise = end - start
    second: FloatArray | float = 0.0
    third: FloatArray | float = 0.0
    a1 = a2 = 0.0
    if len(durations) > 1:
        # Divided differences over the nodes 0, 1, -a1, -a2, in units of the last interval.
        a1 = durations[1] / durations[0]
        older_rise = (start - older) / a1
        second = (rise - older_rise) / (1.0 + a1)
        if len(durations) > 2:
            a2 = durations[2] / durations[0]
            oldest_rise = (older - oldest) / a2
            older_second = (older_rise - oldest_rise) / (a1 + a2)
            third = (second - older_second) / (1.0 + a1 + a2)
    at_start = rise - second - third * a1
    at_end = rise + second + third * (1.0 + a1)
    low, high = np.minimum(0.0, 3.0 * rise), np.maximum(0.0, 3.0 * rise)
    return np.clip(at_start, low, high), np.clip(at_end, low, high)


def tolerance_of(duration_ns: int) -> float:
    """Share of an interval to which a crossing is found: a thousandth of a nanosecond.

    Parameters
    ----------
    duration_ns
        Length of the interval, ns.
    """
    return max(1e-15, 1e-3 / duration_ns)


def monotone_cubic_root(
    rise: FloatArray,
    slope0: FloatArray,
    slope1: FloatArray,
    target: FloatArray,
    tolerance: float = 1e-15,
) -> FloatArray:
    """Where in [0, 1] monotone cubics from 0 to `rise` pass `target`.

    Newton's method within a shrinking bracket.

    Parameters
    ----------
    rise
        Value at 1, not zero, shape (k,).
    slope0
        Slope at 0, between 0 and ``3 rise``, shape (k,).
    slope1
        Slope at 1, between 0 and ``3 rise``, shape (k,).
    target
        Value to find, between 0 and `rise`, shape (k,).
    tolerance
        Largest last step of the search.
    """
    d0, d1, goal = slope0 / rise, slope1 / rise, target / rise
    low, high = np.zeros_like(goal), np.ones_like(goal)
    s = np.clip(goal, 0.0, 1.0)
    active: NDArray[np.intp] = np.arange(goal.size)
    for _ in range(ITERATIONS):
        x, b0, b1 = s[active], d0[active], d1[active]
        excess = x * (b0 + x * (3.0 - 2.0 * b0 - b1 + x * (b0 + b1 - 2.0))) - goal[active]
        high[active] = np.where(excess >= 0, x, high[active])
        low[active] = np.where(excess <= 0, x, low[active])
        slope = b0 + x * (2.0 * (3.0 - 2.0 * b0 - b1) + 3.0 * x * (b0 + b1 - 2.0))
        guess = x - excess / np.where(slope > 0, slope, 1.0)
        inside = (slope > 0) & (guess > low[active]) & (guess < high[active])
        guess = np.where(inside, guess, 0.5 * (low[active] + high[active]))
        s[active] = guess
        active = active[np.abs(guess - x) > tolerance]
        if not active.size:
            break
    return s
