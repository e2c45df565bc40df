"""Luminosities or levels at which the pixels of a large array are silent.

Most pixels of most frames are silent; what is compared with their frame is one number a pixel
where their thresholds are equally far away, and two where not.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.photoreceptor import (
    InvertiblePhotoreceptor,
    LogPhotoreceptor,
    Photoreceptor,
)

# More than three float32 numbers and two products are rounded, relative.
_MARGIN = 1e-6
# Thresholds from which on float32 has too few digits beside the reference.
_WIDEST = 15.0


class Bands(Protocol):
    """What `compiled_pixels.CompiledPixels` asks of the silent bands of its pixels."""

    def find(
        self,
        signal: NDArray[np.generic],
        tile: slice,
        store: NDArray[np.generic],
        mask: NDArray[np.uint8],
        found: NDArray[np.int32],
        number: int,
    ) -> int:
        """Pixels outside their bands; see `band_kernels.find_beside_borders`.

        Parameters
        ----------
        signal
            Luminosities or levels of some pixels, shape (k,).
        tile
            Which pixels.
        store
            Out: the signal, or of no entry.
        mask
            Scratch.
        found
            Out: pixels with news; `number` of them are there already.
        number
            How many.
        """

    def forget(self, pixels: NDArray[np.int64]) -> None:
        """Let pixels have news at the next sample, whatever it is.

        Parameters
        ----------
        pixels
            Pixels, shape (k,).
        """

    def settle(self, found: NDArray[np.int32], edges: FloatArray) -> None:
        """Take new bands.

        Parameters
        ----------
        found
            Pixels, shape (k,).
        edges
            Levels between which each is silent, shape (2, k).
        """


class ScaleBand:
    """Both thresholds equally far from the reference: one number a pixel, its reciprocal.

    Parameters
    ----------
    size
        Number of pixels.
    half_width
        Distance of the thresholds from the reference, as a change of the level.
    receptor
        How luminosity becomes a level.
    kernels
        Module `pixel_kernels`.
    """

    def __init__(
        self, size: int, half_width: float, receptor: LogPhotoreceptor, kernels: Any
    ) -> None:
        self._kernels = kernels
        self._scale = np.full(size, np.nan, np.float32)
        self._limits = (
            np.float32(math.exp(-half_width) * (1 + _MARGIN)),
            np.float32(math.exp(half_width) * (1 - _MARGIN)),
            np.float32(receptor.log_floor),
        )

    def find(
        self,
        signal: NDArray[np.generic],
        tile: slice,
        store: NDArray[np.generic],
        mask: NDArray[np.uint8],
        found: NDArray[np.int32],
        number: int,
    ) -> int:
        """Pixels outside their bands; see `Bands.find`."""
        scale = self._scale[tile]
        new: int = self._kernels.find_beside_scale(
            signal, scale, *self._limits, store, mask, tile.start, found, number
        )
        return new

    def forget(self, pixels: NDArray[np.int64]) -> None:
        """News in any case; see `Bands.forget`."""
        self._scale[pixels] = np.nan

    def settle(self, found: NDArray[np.int32], edges: FloatArray) -> None:
        """New references; see `Bands.settle`. Edges without a middle leave news in any case."""
        with np.errstate(invalid='ignore', over='ignore'):
            middle = edges[0] + edges[1]
            middle *= -0.5
            np.exp(middle, out=middle)
        self._kernels.store_scale(found, middle, self._scale)


class BorderBand:
    """A lower and an upper border for each pixel.

    Parameters
    ----------
    size
        Number of pixels.
    dtype
        Number type of the signal.
    inverse
        How a level becomes a luminosity; None where the signal is the level.
    kernels
        Module `pixel_kernels`.
    """

    def __init__(
        self,
        size: int,
        dtype: np.dtype[Any],
        inverse: InvertiblePhotoreceptor | None,
        kernels: Any,
    ) -> None:
        self._inverse, self._kernels = inverse, kernels
        if inverse is not None and dtype.kind == 'f':
            dtype = np.dtype(np.float32)
        # Empty bands: no pixel is silent until it has been worked on once.
        self._low, self._high = np.ones(size, dtype), np.zeros(size, dtype)

    def find(
        self,
        signal: NDArray[np.generic],
        tile: slice,
        store: NDArray[np.generic],
        mask: NDArray[np.uint8],
        found: NDArray[np.int32],
        number: int,
    ) -> int:
        """Pixels outside their bands; see `Bands.find`."""
        low, high = self._low[tile], self._high[tile]
        new: int = self._kernels.find_beside_borders(
            signal, low, high, store, mask, tile.start, found, number
        )
        return new

    def forget(self, pixels: NDArray[np.int64]) -> None:
        """News in any case; see `Bands.forget`."""
        self._low[pixels], self._high[pixels] = 1, 0

    def settle(self, found: NDArray[np.int32], edges: FloatArray) -> None:
        """New borders; see `Bands.settle`."""
        kernels = self._kernels
        if self._inverse is None:
            kernels.store_level_borders(found, *edges, self._low, self._high)
            return
        borders = self._inverse.luminosity(edges)
        if self._low.dtype.kind == 'f':
            kernels.store_float_borders(found, *borders, self._low, self._high)
        else:
            largest = float(2 ** (8 * self._low.itemsize) - 1)
            kernels.store_integer_borders(found, *borders, self._low, self._high, largest)


def bands_for(
    size: int,
    dtype: np.dtype[Any],
    half_width: float | None,
    receptor: Photoreceptor,
    kernels: Any,
    *,
    levels: bool,
) -> Bands:
    """Bands of pixels none of which is silent yet.

    Parameters
    ----------
    size
        Number of pixels.
    dtype
        Number type of the signal.
    half_width
        Distance of all thresholds from their references; None where it varies.
    receptor
        How luminosity becomes a level.
    kernels
        Module `pixel_kernels`.
    levels
        Whether the signal is the level.
    """
    if levels or not isinstance(receptor, InvertiblePhotoreceptor):
        return BorderBand(size, dtype, None, kernels)
    narrow = half_width is not None and half_width <= _WIDEST
    if dtype.kind == 'f' and narrow and isinstance(receptor, LogPhotoreceptor):
        assert half_width is not None
        return ScaleBand(size, half_width, receptor, kernels)
    return BorderBand(size, dtype, receptor, kernels)
