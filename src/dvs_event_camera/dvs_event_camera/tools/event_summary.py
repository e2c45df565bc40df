"""What a recording holds, as one object that programs read."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from dvs_event_camera.streams.sensor_events import SensorEvents


class EventSummary:
    """Counts and hashes the events that are added to it.

    The hash is over the events in order, each packed as int64 t in ns of the sensor, uint16 x,
    uint16 y and uint8 p in {0, 1}, little-endian.
    """

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._events = self._on = self._triggers = 0
        self._size = (0, 0)
        self._first_ns: int | None = None
        self._last_ns: int | None = None

    def add(self, events: SensorEvents) -> None:
        """Take a stretch; see `EventWriter.add`."""
        self._triggers += len(events.triggers)
        if not len(events):
            return
        self._hash.update(events.packed().data)
        self._events += len(events)
        self._on += int(np.count_nonzero(events.p))
        width, height = self._size
        self._size = (
            max(width, int(events.x.max()) + 1),
            max(height, int(events.y.max()) + 1),
        )
        if self._first_ns is None:
            self._first_ns = int(events.t[0])
        self._last_ns = int(events.t[-1])

    def close(self) -> None:
        """Nothing is left to do; see `EventWriter.close`."""

    def as_dict(self, *, encoding: str, width: int, height: int) -> dict[str, Any]:
        """What was added.

        Parameters
        ----------
        encoding
            How the events are written down.
        width
            Columns of the sensor; 0 for the fewest that hold all events.
        height
            Rows of the sensor; 0 for the fewest that hold all events.
        """
        return {
            'encoding': encoding,
            'width': width or self._size[0],
            'height': height or self._size[1],
            'events': self._events,
            'on': self._on,
            'triggers': self._triggers,
            'first_ns': self._first_ns,
            'last_ns': self._last_ns,
            'sha256': self._hash.hexdigest(),
        }
