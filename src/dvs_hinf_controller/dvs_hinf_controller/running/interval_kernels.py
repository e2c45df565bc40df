"""Packets of many events, compiled: the results of `ReferenceIntervals` bit for bit.

No exponential is taken here: a compiled one may differ from NumPy's in the last bit.
"""

from __future__ import annotations

from typing import Any

from dvs_common.kernel_cache import kernel

_BLOCK = 1024


@kernel
def advance(
    begin: int,
    pixels: Any,
    polarities: Any,
    signs: Any,
    growth: Any,
    reach: int,
    counts: Any,
    pixel_signs: Any,
    first: Any,
    estimate: Any,
    active: Any,
    active_count: int,
    farthest: Any,
    before: Any,
    signs_before: Any,
    jumps: Any,
) -> int:
    """Count events, move the estimates through them and write the jump of their mean at each.

    What an event needs of its pixel is fetched once.

    Parameters
    ----------
    begin
        First event.
    pixels
        Pixel of every event, int64, shape (E,).
    polarities
        +1 or -1, int8, shape (E,).
    signs
        Sign of the reference after the event, int8, shape (E,).
    growth
        ``b^(N h)`` for N from -reach to reach.
    reach
        See there.
    counts
        N of every pixel, int64, shape (r,); moved in place.
    pixel_signs
        Sign of every reference, int8, shape (r,); moved in place.
    first
        Estimate of every pixel at N = 0, shape (r,).
    estimate
        z, shape (r,); moved in place.
    active
        Which pixels count in the mean, shape (r,).
    active_count
        How many they are.
    farthest
        Largest ``|N|`` so far, int64, shape (1,); raised in place.
    before
        Out: estimate of the event's pixel before it, shape (E,).
    signs_before
        Out: sign of its reference before it, int8, shape (E,).
    jumps
        Out: shape (E,).

    Returns
    -------
    int
        First event whose N is out of reach, or E; the events before it have been taken.
    """
    size: int = pixels.size
    far = farthest[0]
    for start in range(begin, size, _BLOCK):
        end = min(start + _BLOCK, size)
        # The records of a block are fetched by a loop that waits for none of them.
        for e in range(start, end):
            far = max(far, abs(counts[pixels[e]]))
        for e in range(start, end):
            i = pixels[e]
            number = counts[i] + polarities[e]
            if number > reach or number < -reach:
                farthest[0] = far
                return e
            far = max(far, abs(number))
            counts[i] = number
            before[e], signs_before[e] = estimate[i], pixel_signs[i]
            after = signs[e] * first[i] * growth[number + reach]
            jumps[e] = (after - before[e]) / active_count if active[i] else 0.0
            estimate[i] = after
            pixel_signs[i] = signs[e]
    farthest[0] = far
    return size


@kernel
def take_back(
    end: int,
    pixels: Any,
    polarities: Any,
    counts: Any,
    pixel_signs: Any,
    estimate: Any,
    before: Any,
    signs_before: Any,
) -> None:
    """Take back what `advance` did, from the last event to the first.

    Parameters
    ----------
    end
        Number of events that it has taken.
    pixels
        Pixel of every event, shape (E,).
    polarities
        +1 or -1, shape (E,).
    counts
        N of every pixel, shape (r,); moved in place.
    pixel_signs
        Sign of every reference, shape (r,); moved in place.
    estimate
        z, shape (r,); moved in place.
    before
        Estimate of the event's pixel before it, shape (E,).
    signs_before
        Sign of its reference before it, shape (E,).
    """
    for k in range(end):
        e = end - 1 - k
        i = pixels[e]
        counts[i] -= polarities[e]
        estimate[i], pixel_signs[i] = before[e], signs_before[e]
