"""Threshold crossings of one interval: the hysteresis quantiser and its stamps, in NumPy.

Everything is counted in steps of the threshold: a pixel whose level is ``v`` steps above its
first reference and whose polarities sum to ``N`` fires when ``|v - N| >= 1`` (paper, eq. 5), and
comes to rest at ``floor(v)`` on the way up, ``ceil(v)`` on the way down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.pixel_events import PixelEvents

CountArray = NDArray[np.int32]


class RawEvents(NamedTuple):
    """Events before sorting; times count from the start of the interval."""

    elapsed: NDArray[np.int64]
    pixel: NDArray[np.int64]
    polarity: NDArray[np.int8]
    sign: NDArray[np.int8]

    def in_order(self, start_ns: int) -> PixelEvents:
        """Sort by (time, pixel).

        Parameters
        ----------
        start_ns
            Start of the interval, ns.
        """
        return PixelEvents.sorted_from(start_ns, *self)


NO_EVENTS = RawEvents(
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int8), np.empty(0, np.int8)
)


def join(parts: list[RawEvents]) -> RawEvents:
    """One set of events out of several.

    Parameters
    ----------
    parts
        At least one set.
    """
    return RawEvents(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def quantise(v: FloatArray, counts: CountArray) -> CountArray:
    """Sum of polarities after the level has moved monotonically to `v` steps.

    Parameters
    ----------
    v
        Level in steps above the first reference, finite, shape (k,).
    counts
        N before the move, shape (k,).

    Returns
    -------
    CountArray
        N after the move: ``|v - N| < 1``, and N unchanged where that held already.
    """
    moved = np.where(v >= counts + 1.0, np.floor(v), counts)
    return np.where(v <= counts - 1.0, np.ceil(v), moved).astype(np.int32)


def group_ranks(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, ..., sizes[0] - 1, 0, 1, ..., sizes[1] - 1, ...

    Parameters
    ----------
    sizes
        Sizes of the groups, shape (k,).
    """
    ends = np.cumsum(sizes)
    return np.arange(int(ends[-1]) if ends.size else 0) - np.repeat(ends - sizes, sizes)


def stamp(elapsed: FloatArray, duration_ns: int) -> NDArray[np.int64]:
    """First whole nanosecond at or after a crossing, in (0, duration].

    Parameters
    ----------
    elapsed
        Time of the crossing since the start of the interval, ns, shape (k,).
    duration_ns
        Length of the interval, ns, >= 1.
    """
    return np.minimum(np.maximum(np.ceil(elapsed), 1.0), float(duration_ns)).astype(np.int64)


def ladder(
    before: CountArray, after: CountArray
) -> tuple[NDArray[np.int64], NDArray[np.int8], FloatArray]:
    """The thresholds passed on the way from one count to another.

    Parameters
    ----------
    before
        N before, shape (k,).
    after
        N after, shape (k,).

    Returns
    -------
    owner, polarity, threshold
        For each event in turn: which of the k pixels, +1 or -1, and the threshold in steps.
    """
    change = after.astype(np.int64) - before
    sizes = np.abs(change)
    owner = np.repeat(np.arange(sizes.size), sizes)
    polarity = np.sign(change).astype(np.int8)[owner]
    threshold = before[owner] + polarity * (group_ranks(sizes) + 1.0)
    return owner, polarity, threshold


def linear_crossings(
    previous: FloatArray,
    current: FloatArray,
    counts: CountArray,
    *,
    duration_ns: int,
    first_pixel: int = 0,
) -> RawEvents:
    """Events of an interval in which the level is linear in time; `counts` moves with them.

    Parameters
    ----------
    previous
        Level at the start of the interval, in steps above the first reference, shape (k,).
    current
        The same at its end, finite, shape (k,).
    counts
        N, shape (k,); updated in place.
    duration_ns
        Length of the interval, ns.
    first_pixel
        Index of the first of the k pixels.
    """
    index = np.flatnonzero((current >= counts + 1.0) | (current <= counts - 1.0))
    if not index.size:
        return NO_EVENTS
    start, end, before = previous[index], current[index], counts[index]
    after = quantise(end, before)
    counts[index] = after
    owner, polarity, threshold = ladder(before, after)
    pace = duration_ns / (end - start)
    return RawEvents(
        stamp((threshold - start[owner]) * pace[owner], duration_ns),
        index[owner] + first_pixel,
        polarity,
        np.ones(owner.size, np.int8),
    )


def hold_invalid(levels: FloatArray, previous: FloatArray) -> int:
    """Replace levels that are not finite by the previous ones; return how many there were.

    Parameters
    ----------
    levels
        New levels, shape (k,); overwritten.
    previous
        Last levels, shape (k,).
    """
    valid: NDArray[np.bool_] = np.isfinite(levels)
    if valid.all():
        return 0
    np.copyto(levels, previous, where=~valid)
    return int(valid.size - np.count_nonzero(valid))
