"""From the pixels of an image to those of the camera, as `pixel_map` has it for events."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.wire.cdr import MessageError
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_event_camera.streams.pixel_map import PixelMap


class FrameMap:
    """Crops and bins the images of one stream.

    A pixel whose image pixels are all masked keeps its first luminosity, so that it never fires.

    Parameters
    ----------
    pixel_map
        Which pixels of an image belong to which pixel of the camera.
    """

    def __init__(self, pixel_map: PixelMap) -> None:
        self._map = pixel_map
        self.changes_nothing = pixel_map == PixelMap()
        self._shape: tuple[int, ...] = ()
        self._used: NDArray[np.bool_] = np.empty(0, np.bool_)
        self._first: NDArray[np.float64] = np.empty(0)

    def mapped(self, frame: LuminosityFrame) -> LuminosityFrame:
        """Frame of the camera's pixels.

        Parameters
        ----------
        frame
            The whole image.

        Raises
        ------
        MessageError
            If the region reaches beyond the image.
        """
        if self.changes_nothing:
            return frame
        height, width = frame.pixels.shape
        try:
            columns, rows = self._map.size(width, height)
        except ParameterError as error:
            raise MessageError(str(error)) from None
        size = self._map.binning
        left, top = self._map.region[:2] or (0, 0)
        part = frame.pixels[top : top + rows * size, left : left + columns * size]
        if size == 1 and not self._map.masked:
            return replace(frame, pixels=np.ascontiguousarray(part))
        if frame.pixels.shape != self._shape:
            self._shape = frame.pixels.shape
            self._used = self._unmasked()[top : top + rows * size, left : left + columns * size]
            self._first = _block_sums(part, size) / size**2
        used = _block_sums(self._used, size)
        mean = _block_sums(np.where(self._used, part, 0), size) / np.maximum(used, 1)
        return replace(frame, pixels=np.where(used > 0, mean, self._first))

    def _unmasked(self) -> NDArray[np.bool_]:
        used = np.ones(self._shape, np.bool_)
        x, y = np.array(self._map.masked, np.int64).reshape(-1, 2).T
        inside = (x < self._shape[1]) & (y < self._shape[0])
        used[y[inside], x[inside]] = False
        return used


def _block_sums(values: NDArray[Any], size: int) -> NDArray[np.float64]:
    """Sums over squares of `size` pixels."""
    rows, columns = values.shape[0] // size, values.shape[1] // size
    blocks = values.reshape(rows, size, columns, size)
    sums: NDArray[np.float64] = blocks.sum(axis=(1, 3), dtype=np.float64)
    return sums
