"""The table `x y t p` that `show_events` prints."""

from __future__ import annotations

from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dvs_event_camera.streams.sensor_events import SensorEvents

_ROW = '{:5d} {:5d} {:19d} {:+2d}\n'
_HEAD = '{:>5} {:>5} {:>19} {:>2}\n'


class EventTable:
    """Lines ``x y t p`` with t in nanoseconds and p as +1 or -1, and the label if there is one.

    Parameters
    ----------
    stream
        Where to write.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        stream.write(_HEAD.format('x', 'y', 't', 'p'))

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`."""
        polarity = 2 * events.p.astype(np.int8) - 1
        columns: list[NDArray[Any]] = [events.x, events.y, events.t, polarity]
        line = _ROW
        if events.noise is not None:
            columns.append(events.noise)
            line = _ROW.rstrip('\n') + ' {:d}\n'
        rows = zip(*(column.tolist() for column in columns), strict=True)
        self._stream.write(''.join(line.format(*row) for row in rows))

    def close(self) -> None:
        """Flush; see `EventWriter.close`."""
        self._stream.flush()
