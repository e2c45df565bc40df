"""Packets of many events, compiled: the results of `ReferenceIntervals` bit for bit.

No exponential is taken here: a compiled one may differ from NumPy's in the last bit.
"""

from __future__ import annotations

from typing import Any

from dvs_common.kernel_cache import kernel


@kernel
def count(pixels: Any, polarities: Any, counts: Any, running: Any) -> tuple[int, int]:
    """Count events one after the other.

    Parameters
    ----------
    pixels
        Pixel of every event, int64, shape (E,), E > 0.
    polarities
        +1 or -1, int8, shape (E,).
    counts
        N of every pixel, int64, shape (r,); moved in place.
    running
        Out: N of the event's pixel after it, int64, shape (E,).

    Returns
    -------
    tuple of int
        Least and greatest of `running`.
    """
    low = high = counts[pixels[0]] + polarities[0]
    for e in range(pixels.size):
        number = counts[pixels[e]] + polarities[e]
        counts[pixels[e]] = number
        running[e] = number
        low = min(low, number)
        high = max(high, number)
    return low, high


@kernel
def uncount(pixels: Any, polarities: Any, counts: Any) -> None:
    """Take back what `count` did to `counts`.

    Parameters
    ----------
    pixels
        Pixel of every event, shape (E,).
    polarities
        +1 or -1, shape (E,).
    counts
        N of every pixel, shape (r,); moved in place.
    """
    for e in range(pixels.size):
        counts[pixels[e]] -= polarities[e]


@kernel
def jump(
    pixels: Any,
    signs: Any,
    running: Any,
    growth: Any,
    lowest: int,
    first: Any,
    estimate: Any,
    pixel_signs: Any,
    active: Any,
    active_count: int,
    jumps: Any,
) -> None:
    """Move the estimates through the events; write the jump of their mean at each.

    Parameters
    ----------
    pixels
        Pixel of every event, shape (E,).
    signs
        Sign of the reference after the event, shape (E,).
    running
        N of the event's pixel after it, shape (E,).
    growth
        ``b^(N h)`` for N from `lowest` on.
    lowest
        N of the first entry of `growth`.
    first
        Estimate of every pixel at N = 0, shape (r,).
    estimate
        z, shape (r,); moved in place.
    pixel_signs
        Sign of every reference, shape (r,); moved in place.
    active
        Which pixels count in the mean, shape (r,).
    active_count
        How many they are.
    jumps
        Out: shape (E,).
    """
    for e in range(pixels.size):
        i = pixels[e]
        after = signs[e] * first[i] * growth[running[e] - lowest]
        jumps[e] = (after - estimate[i]) / active_count if active[i] else 0.0
        estimate[i] = after
        pixel_signs[i] = signs[e]
