"""Compiled pixels: gathering, sorting and labelling; others have the frame pass and the events.

Same results as the NumPy comparators, bit for bit. No logarithm is taken here: a compiled one may
differ from NumPy's in the last bit. What is left is IEEE arithmetic in the same order, which numba
neither contracts nor reorders.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel
from dvs_event_camera.pixels.band_kernels import (
    TILE,
    find_beside_borders,
    find_beside_scale,
    store_float_borders,
    store_integer_borders,
    store_level_borders,
    store_scale,
)
from dvs_event_camera.pixels.firing_kernels import fire_ideal, fire_imperfect
from dvs_event_camera.pixels.level_kernels import leak, low_pass

__all__ = [
    'TILE',
    'find_beside_borders',
    'find_beside_scale',
    'fire_ideal',
    'fire_imperfect',
    'gather',
    'hold_invalid',
    'label_events',
    'leak',
    'low_pass',
    'merge',
    'pack_records',
    'radix_sort',
    'store_float_borders',
    'store_integer_borders',
    'store_level_borders',
    'store_scale',
    'unpack_keys',
]

# Bits of a digit: as many counters stay in the first-level cache.
_DIGIT = 11


@kernel
def gather(values: Any, found: Any, out: Any) -> None:
    """Values of some pixels as float64.

    Parameters
    ----------
    values
        Of all pixels.
    found
        Indices, shape (k,).
    out
        Out: float64, shape (k,).
    """
    for k in range(found.size):
        out[k] = values[found[k]]


@kernel
def hold_invalid(found: Any, now: Any, before: Any, origin: Any, held: Any) -> int:
    """Replace levels that are not finite by the previous ones; return how many there were.

    A pixel without light so far rests on its reference.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    now, before
        Their new and previous levels, float64, shape (k,); overwritten.
    origin
        Level of the first reference of all pixels, float64.
    held
        Out: the pixels that hold, int32, shape (k,).
    """
    invalid = 0
    for k in range(found.size):
        if not np.isfinite(before[k]):
            before[k] = origin[found[k]]
        if not np.isfinite(now[k]):
            now[k] = before[k]
            held[invalid] = found[k]
            invalid += 1
    return invalid


@kernel
def radix_sort(keys: Any, scratch: Any, first_bit: int, last_bit: int) -> None:
    """Sort keys whose bits below `first_bit` are in order already, or nearly so.

    Digit by digit from the lowest (Knuth, *The Art of Computer Programming* 3, section 5.2.5),
    then neighbours that are out of order because of the bits below.

    Parameters
    ----------
    keys
        Non-negative int64, shape (k,); sorted in place.
    scratch
        As large as `keys`.
    first_bit, last_bit
        Bits to sort by; those from `last_bit` on are zero.
    """
    bits = max(last_bit - first_bit, 1)
    passes = (bits + _DIGIT - 1) // _DIGIT
    width = (bits + passes - 1) // passes
    mask = (1 << width) - 1
    place = np.empty(1 << width, np.int64)
    source, target = keys, scratch
    for turn in range(passes):
        shift = first_bit + turn * width
        place[:] = 0
        for k in range(source.size):
            place[(source[k] >> shift) & mask] += 1
        below = 0
        for digit in range(place.size):
            below, place[digit] = below + place[digit], below
        for k in range(source.size):
            digit = (source[k] >> shift) & mask
            target[place[digit]] = source[k]
            place[digit] += 1
        source, target = target, source
    if passes % 2:
        for k in range(source.size):
            target[k] = source[k]
    for k in range(1, keys.size):
        key, j = keys[k], k
        while j > 0 and keys[j - 1] > key:
            keys[j] = keys[j - 1]
            j -= 1
        keys[j] = key


@kernel
def unpack_keys(
    keys: Any, start_ns: int, shift: int, t: Any, pixel: Any, polarity: Any, flag: Any
) -> None:
    """Sorted keys to columns.

    Parameters
    ----------
    keys
        Sorted keys, int64, shape (k,).
    start_ns
        Time from which the keys' times count, ns.
    shift
        Where the time begins.
    t
        Out: absolute time, int64, shape (k,).
    pixel
        Out: pixel, int32, shape (k,).
    polarity
        Out: +1 or -1, int8, shape (k,).
    flag
        Out: the lowest bit, int8, shape (k,).
    """
    pixels = (1 << (shift - 2)) - 1
    for i in range(keys.size):
        key = keys[i]
        t[i] = (key >> shift) + start_ns
        pixel[i] = (key >> 2) & pixels
        polarity[i] = (key & 2) - 1
        flag[i] = key & 1


@kernel
def merge(one: Any, other: Any, out: Any) -> None:
    """Two sorted arrays as one.

    Parameters
    ----------
    one, other
        Sorted, int64.
    out
        Out: as large as both.
    """
    i, j = 0, 0
    for k in range(out.size):
        if j >= other.size or (i < one.size and one[i] <= other[j]):
            out[k] = one[i]
            i += 1
        else:
            out[k] = other[j]
            j += 1


@kernel
def label_events(pixel: Any, polarity: Any, noise: Any, owed: Any) -> None:
    """Label what pays the debts of noise; see `noise_labels.NoiseLabels`.

    Parameters
    ----------
    pixel, polarity
        Events in order, shape (k,).
    noise
        1 for spurious events, int8, shape (k,); updated in place.
    owed
        Polarity owed by noise of all pixels, int64; updated in place.
    """
    for k in range(pixel.size):
        debt = owed[pixel[k]]
        if noise[k] > 0:
            owed[pixel[k]] = debt - polarity[k]
        elif debt * polarity[k] > 0:
            noise[k] = 1
            owed[pixel[k]] = debt - polarity[k]


@kernel
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
