"""Compiled pixels: the pass over a frame that finds the pixels outside their silent bands.

Tile by tile, so that what is marked of a tile, and the tile itself where it is copied, are still
in the first-level cache.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel

# Pixels of a tile, a multiple of 8; as many octets has `mask`.
TILE = 2048
_ONE, _OCTETS, _LAST_OCTET = np.uint64(1), np.uint64(0x0101010101010101), np.uint64(56)
_F4_MAX = 3.4028e38
_F4_MIN = 1.2e-38


@kernel
def _listed(mask: Any, size: int, first: int, found: Any, number: int) -> int:
    """Write down the marked pixels of a tile that begins with pixel `first`."""
    mask[size : size + 7] = 0
    words = mask[: (size + 7) // 8 * 8].view(np.uint64)
    for word in range(words.size):
        left = words[word]
        while left:
            # Below its lowest one the word has as many whole octets as pixels are passed over.
            below = (left - _ONE) & ~left
            passed = ((below & _OCTETS) * _OCTETS) >> _LAST_OCTET
            found[number] = first + 8 * word + np.int64(passed)
            number += 1
            left &= left - _ONE
    return number


@kernel
def _mark_beside_borders(signal: Any, low: Any, high: Any, mask: Any) -> None:
    # Loops without branches, which the compiler turns into vector instructions.
    for i in range(signal.size):
        y = signal[i]
        # Negated so that NaN is news.
        mask[i] = not ((y >= low[i]) & (y <= high[i]))


@kernel
def _mark_beside_scale(
    signal: Any, scale: Any, low: float, high: float, floor: float, mask: Any
) -> None:
    for i in range(signal.size):
        light = np.float32(signal[i])
        # NaN stays NaN.
        share = (floor if light < floor else light) * scale[i]
        mask[i] = not ((share >= low) & (share <= high))


@kernel
def _copied(tile: Any, store: Any) -> None:
    for i in range(tile.size):
        store[i] = tile[i]


@kernel
def find_beside_borders(
    signal: Any, low: Any, high: Any, store: Any, mask: Any, first: int, found: Any, number: int
) -> int:
    """Pixels whose signal lies outside its silent band, and a copy of the signal.

    Parameters
    ----------
    signal
        Luminosities or levels of some pixels, shape (k,).
    low, high
        Smallest and largest silent value of each, shape (k,).
    store
        Out: the signal, shape (k,); of no entry where it need not be copied.
    mask
        Scratch, uint8, `TILE` + 8 entries.
    first
        Index of the first of the pixels.
    found
        Out: indices of the pixels with news, int32; `number` of them are there already.
    number
        How many.

    Returns
    -------
    int
        Number of pixels in `found`.
    """
    for begin in range(0, signal.size, TILE):
        end = min(begin + TILE, signal.size)
        tile = signal[begin:end]
        _mark_beside_borders(tile, low[begin:end], high[begin:end], mask)
        if store.size:
            _copied(tile, store[begin:end])
        number = _listed(mask, end - begin, first + begin, found, number)
    return number


@kernel
def find_beside_scale(
    signal: Any,
    scale: Any,
    low: float,
    high: float,
    floor: float,
    store: Any,
    mask: Any,
    first: int,
    found: Any,
    number: int,
) -> int:
    """Pixels whose luminosity over their reference lies outside `low` and `high`.

    One number a pixel is read beside its luminosity: the pass is bound by memory.

    Parameters
    ----------
    signal
        Luminosities of some pixels, shape (k,).
    scale
        Reciprocal of each reference, float32, shape (k,); NaN where there is news in any case.
    low, high
        Smallest and largest silent share, float32.
    floor
        Luminosity below which the photoreceptor sees no difference, float32.
    store, mask, first, found, number
        See `find_beside_borders`.

    Returns
    -------
    int
        Number of pixels in `found`.
    """
    for begin in range(0, signal.size, TILE):
        end = min(begin + TILE, signal.size)
        tile = signal[begin:end]
        _mark_beside_scale(tile, scale[begin:end], low, high, floor, mask)
        if store.size:
            _copied(tile, store[begin:end])
        number = _listed(mask, end - begin, first + begin, found, number)
    return number


@kernel
def store_scale(found: Any, scales: Any, scale: Any) -> None:
    """Reciprocals of references as float32; NaN where float32 has too few digits of them.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    scales
        Their reciprocals, float64, shape (k,).
    scale
        Out: those of all pixels, float32.
    """
    for k in range(found.size):
        new = scales[k]
        scale[found[k]] = new if (new > 1e-31) & (new < 1e31) else np.nan


@kernel
def store_float_borders(found: Any, lower: Any, upper: Any, low: Any, high: Any) -> None:
    """Borders of the silent bands as float32, rounded inwards.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Luminosities between which they are silent, float64, shape (k,).
    low, high
        Out: borders of all pixels, float32.
    """
    for k in range(found.size):
        a, b = lower[k] * (1.0 + 2e-7), upper[k] * (1.0 - 2e-7)
        if a > 0.0 and a < _F4_MIN:
            a = _F4_MIN
        if b > _F4_MAX:
            b = _F4_MAX
        low[found[k]] = a
        high[found[k]] = b


@kernel
def store_integer_borders(
    found: Any, lower: Any, upper: Any, low: Any, high: Any, largest: float
) -> None:
    """Borders of the silent bands as integers.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Luminosities between which they are silent, float64, shape (k,).
    low, high
        Out: smallest and largest silent value of all pixels, unsigned.
    largest
        Largest value of their type.
    """
    for k in range(found.size):
        a = max(np.ceil(lower[k] * (1.0 + 1e-9)), 0.0)
        b = min(np.floor(upper[k] * (1.0 - 1e-9)), largest)
        silent = a <= b
        low[found[k]] = a if silent else 1.0
        high[found[k]] = b if silent else 0.0


@kernel
def store_level_borders(found: Any, lower: Any, upper: Any, low: Any, high: Any) -> None:
    """Borders of the silent bands where the signal is the level itself.

    Parameters
    ----------
    found
        Pixels, int32, shape (k,).
    lower, upper
        Levels between which they are silent, float64, shape (k,).
    low, high
        Out: borders of all pixels, float64.
    """
    for k in range(found.size):
        low[found[k]] = lower[k]
        high[found[k]] = upper[k]
