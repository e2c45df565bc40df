"""From the pixels of a sensor to those of a loop: a region, bins of several pixels, a mask."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_event_camera.streams.sensor_events import SensorEvents

_REGION_ENTRIES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelMap:
    """Which pixels of a sensor belong to which pixel of the loop.

    Parameters
    ----------
    region
        Left column, upper row, columns and rows of the part that is used; empty for the whole
        sensor.
    binning
        Columns, and rows, of the square of sensor pixels that make one of the loop.
    masked
        Sensor pixels that are left out: x, y, x, y, ...

    Raises
    ------
    ParameterError
        If a number breaks its rule.
    """

    region: tuple[int, ...] = ()
    binning: int = 1
    masked: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.region and (
            len(self.region) != _REGION_ENTRIES
            or min(self.region[:2]) < 0
            or min(self.region[2:]) < 1
        ):
            raise ParameterError(
                'region', list(self.region), 'must be x >= 0, y >= 0, width >= 1, height >= 1'
            )
        if self.binning < 1:
            raise ParameterError('binning', self.binning, 'must be >= 1')
        if self.region and min(self.region[2:]) < self.binning:
            raise ParameterError('binning', self.binning, 'must fit the region')
        if len(self.masked) % 2 or min(self.masked, default=0) < 0:
            raise ParameterError(
                'masked_pixels', list(self.masked), 'must be pairs x, y of numbers >= 0'
            )

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Columns and rows that the loop sees.

        Parameters
        ----------
        width
            Columns of the sensor.
        height
            Rows of the sensor.

        Raises
        ------
        ParameterError
            If the region reaches beyond the sensor.
        """
        x, y, columns, rows = self.region or (0, 0, width, height)
        if x + columns > width or y + rows > height:
            raise ParameterError(
                'region', list(self.region), f'reaches beyond the {width} x {height} pixels'
            )
        return columns // self.binning, rows // self.binning

    def mapped(self, events: SensorEvents, width: int, height: int) -> SensorEvents:
        """Events of the loop's pixels; those of others are left out.

        Parameters
        ----------
        events
            Events of the sensor.
        width
            Columns of the sensor.
        height
            Rows of the sensor.

        Raises
        ------
        ParameterError
            If the region reaches beyond the sensor.
        """
        columns, rows = self.size(width, height)
        left, top = self.region[:2] or (0, 0)
        x = (events.x.astype(np.int32) - left) // self.binning
        y = (events.y.astype(np.int32) - top) // self.binning
        inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
        if self.masked:
            inside &= ~np.isin(_place(events.x, events.y), self._masked_places())
        columns_kept, rows_kept = x[inside].astype(np.uint16), y[inside].astype(np.uint16)
        return replace(events.take(inside), x=columns_kept, y=rows_kept)

    def _masked_places(self) -> NDArray[np.int64]:
        pairs = np.array(self.masked, np.int64).reshape(-1, 2)
        return _place(pairs[:, 0], pairs[:, 1])


def _place(x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[np.int64]:
    return y.astype(np.int64) << 32 | x.astype(np.int64)
