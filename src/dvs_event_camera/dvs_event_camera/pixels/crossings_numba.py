"""The crossings of `crossings.linear_crossings`, compiled: same results, bit for bit.

No logarithm is taken here: a compiled one may differ from NumPy's in the last bit. What is left is
IEEE arithmetic in the same order, which numba neither contracts nor reorders.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from dvs_event_camera.pixels.event_flood import MOST_STEPS as _MOST_STEPS


@numba.njit(cache=True, error_model='numpy', nogil=True)
def find_news(levels: Any, origin: Any, counts: Any, step: float, mask: Any, found: Any) -> int:
    """Levels in steps above the first reference, and the pixels that have news.

    Parameters
    ----------
    levels
        Levels, float64, shape (k,); turned into steps in place.
    origin
        Level of the first reference, float64, shape (k,).
    counts
        N, int32, shape (k,).
    step
        Threshold as a change of the level, ``h ln b``.
    mask
        Scratch, uint8, at least k entries and a multiple of 8.
    found
        Out: pixels that fire or whose level is not finite, int32, as large as `mask`.

    Returns
    -------
    int
        Number of pixels in `found`.
    """
    size = levels.size
    # A loop without branches, which the compiler turns into vector instructions.
    for i in range(size):
        v = (levels[i] - origin[i]) / step
        levels[i] = v
        # Negated so that NaN is news.
        mask[i] = not ((v < counts[i] + 1.0) & (v > counts[i] - 1.0))
    padded = (size + 7) // 8 * 8
    for i in range(size, padded):
        mask[i] = 0
    words = mask[:padded].view(np.uint64)
    number = 0
    for word in range(words.size):
        if words[word] != 0:
            # No branch for the processor to guess wrong, unlike an `if` on every pixel.
            for i in range(8 * word, 8 * word + 8):
                found[number] = i
                number += int(mask[i])
    return number


@numba.njit(cache=True, error_model='numpy', nogil=True)
def fire(
    levels: Any,
    previous: Any,
    counts: Any,
    found: Any,
    duration_ns: int,
    first_pixel: int,
    pixel_bits: int,
    keys: Any,
    used: int,
    invalid: Any,
) -> tuple[int, int, int]:
    """Append the sort keys of a tile's events to `keys`; move `counts`.

    Parameters
    ----------
    levels
        Levels at the end of the interval in steps, float64, shape (k,); those that are not finite
        are replaced by the previous ones.
    previous
        Levels at its start in steps, float64, shape (k,).
    counts
        N, int32, shape (k,); updated in place.
    found
        Pixels to deal with, from `find_news`, int32, shape (c,).
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
    invalid
        Counter of samples without meaning, int64, shape (1,).

    Returns
    -------
    done, used, needed
        Entries of `found` dealt with, all of them unless the buffer is full; keys in the buffer;
        keys that it must be able to hold to go on.
    """
    duration = float(duration_ns)
    for place in range(found.size):
        i = found[place]
        end, start, before = levels[i], previous[i], counts[i]
        if not np.isfinite(end):
            levels[i] = start
            invalid[0] += 1
            continue
        up = end > before
        rest = np.floor(end) if up else np.ceil(end)
        polarity = 1 if up else -1
        if abs(rest) > _MOST_STEPS:
            return place, used, int(min(abs(rest), 1e18))
        after = np.int32(rest)
        rungs = abs(int(after) - before)
        if used + rungs > keys.size:
            return place, used, used + rungs
        counts[i] = after
        pace = duration / (end - start)
        low = ((first_pixel + i) << 2) | (polarity + 1)
        for rung in range(1, rungs + 1):
            threshold = before + polarity * (rung * 1.0)
            elapsed = min(max(np.ceil((threshold - start) * pace), 1.0), duration)
            keys[used] = (np.int64(elapsed) << (pixel_bits + 2)) | low
            used += 1
    return found.size, used, used


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


@numba.njit(cache=True, error_model='numpy', nogil=True)
def pack_records(
    t: Any,
    pixel: Any,
    polarity: Any,
    sign: Any,
    width: int,
    stamp_ns: int,
    first_index: int,
    words: Any,
) -> None:
    """Records of `dvs_common.wire.events.EVENT_DTYPE`: `make_events` in one pass.

    Parameters
    ----------
    t
        Absolute time, int64, ns, shape (k,).
    pixel
        Row-major pixel, int32, shape (k,).
    polarity
        +1 or -1, int8, shape (k,).
    sign
        +1 or -1, int8, shape (k,).
    width
        Columns of the pixel array.
    stamp_ns
        Stamp of the packet, ns.
    first_index
        Running number of the first event.
    words
        Out: two 64-bit words an event, uint64, shape (k, 2).
    """
    columns = np.int32(width)
    for i in range(t.size):
        row = pixel[i] // columns
        column = pixel[i] - row * columns
        place = np.uint64(column) | np.uint64(row) << np.uint64(16)
        relative = np.uint64(np.uint32(t[i] - stamp_ns))
        words[i, 0] = place | relative << np.uint64(32)
        flags = np.uint64(np.uint8(polarity[i])) | np.uint64(np.uint8(sign[i])) << np.uint64(8)
        words[i, 1] = np.uint64(np.uint32(first_index + i)) | flags << np.uint64(32)
