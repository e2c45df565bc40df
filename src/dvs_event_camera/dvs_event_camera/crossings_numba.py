"""The crossings of `crossings.linear_log_crossings`, compiled: same results, bit for bit.

No logarithm is taken here: a compiled one may differ from NumPy's in the last bit. What is left is
IEEE arithmetic in the same order, which numba neither contracts nor reorders.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np


@numba.njit(cache=True, error_model='numpy', nogil=True)
def fire_tile(
    levels: Any,
    previous: Any,
    origin: Any,
    counts: Any,
    step: float,
    duration_ns: int,
    first_pixel: int,
    pixel_bits: int,
    keys: Any,
    used: int,
    mask: Any,
    invalid: Any,
) -> int:
    """Append the sort keys of a tile's events to `keys`; move `counts` and `previous`.

    Parameters
    ----------
    levels
        Levels at the end of the interval, float64, shape (k,); not finite where without meaning,
        and replaced there by the previous level.
    previous
        Levels at its start, float64, shape (k,); set to `levels`.
    origin
        Level of the first reference, float64, shape (k,).
    counts
        N, int32, shape (k,); updated in place.
    step
        Threshold as a change of the level, ``h ln b``.
    duration_ns
        Length of the interval, ns.
    first_pixel
        Index of the tile's first pixel.
    pixel_bits
        Width of the keys' pixel field.
    keys
        int64 buffer that holds `used` keys already.
    used
        Number of keys in the buffer.
    mask
        Scratch, uint8, at least k entries and a multiple of 8.
    invalid
        Counter of samples without meaning, int64, shape (1,).

    Returns
    -------
    int
        Number of keys in the buffer; negative if it is too small, and then its absolute value is
        what it must hold and nothing has changed.
    """
    size = levels.size
    for i in range(size):
        v = (levels[i] - origin[i]) / step
        # Negated so that NaN counts as news.
        mask[i] = not ((v < counts[i] + 1.0) & (v > counts[i] - 1.0))
    for i in range(size, (size + 7) // 8 * 8):
        mask[i] = 0
    words = mask[: (size + 7) // 8 * 8].view(np.uint64)

    needed = used
    for word in range(words.size):
        if words[word] != 0:
            for i in range(8 * word, 8 * word + 8):
                if mask[i]:
                    v = (levels[i] - origin[i]) / step
                    if np.isfinite(v):
                        # A move to floor(v) or ceil(v), whichever is nearer.
                        needed += int(abs(v - counts[i]))
    if needed > keys.size:
        return -needed

    duration = float(duration_ns)
    for word in range(words.size):
        if words[word] != 0:
            for i in range(8 * word, 8 * word + 8):
                if not mask[i]:
                    continue
                v1 = (levels[i] - origin[i]) / step
                if not np.isfinite(v1):
                    levels[i] = previous[i]
                    invalid[0] += 1
                    continue
                before = counts[i]
                v0 = (previous[i] - origin[i]) / step
                rise = v1 - v0
                if v1 >= before + 1.0:
                    after, polarity = np.int32(np.floor(v1)), 1
                else:
                    after, polarity = np.int32(np.ceil(v1)), -1
                low = ((first_pixel + i) << 2) | (polarity + 1)
                for rung in range(1, abs(after - before) + 1):
                    threshold = before + polarity * (rung * 1.0)
                    elapsed = np.ceil((threshold - v0) / rise * duration)
                    elapsed = min(max(elapsed, 1.0), duration)
                    keys[used] = (np.int64(elapsed) << (pixel_bits + 2)) | low
                    used += 1
                counts[i] = after
    for i in range(size):
        previous[i] = levels[i]
    return used


@numba.njit(cache=True, error_model='numpy', nogil=True)
def unpack_keys(
    keys: Any, start_ns: int, pixel_bits: int, t: Any, pixel: Any, polarity: Any, sign: Any
) -> None:
    """Sorted keys to columns: `PixelEvents.from_keys` in one pass.

    Parameters
    ----------
    keys
        Sorted keys, int64, shape (k,).
    start_ns
        Time from which the keys' times count, ns.
    pixel_bits
        Width of the pixel field.
    t
        Out: absolute time, int64, shape (k,).
    pixel
        Out: pixel, int32, shape (k,).
    polarity
        Out: +1 or -1, int8, shape (k,).
    sign
        Out: +1 or -1, int8, shape (k,).
    """
    pixels = (1 << pixel_bits) - 1
    for i in range(keys.size):
        key = keys[i]
        t[i] = (key >> (pixel_bits + 2)) + start_ns
        pixel[i] = (key >> 2) & pixels
        polarity[i] = (key & 2) - 1
        sign[i] = 1 - ((key & 1) << 1)
