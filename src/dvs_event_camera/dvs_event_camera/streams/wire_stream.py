"""Events of a sensor as packets of the wire contract: sorted, stamped, numbered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.wire.events import (
    EVENT_DTYPE,
    INDEX_MODULUS,
    LABELLED_EVENT_DTYPE,
    NO_EVENTS,
    EventPacket,
)
from dvs_event_camera.streams.sensor_events import SensorEvents

# Time that a packet may cover: the sort key has 30 bits for it.
_LONGEST_NS = 2**30 - 1
# Time that goes back by more is a new start of the camera.
_RESTART_NS = NANOSECONDS


class WireStream:
    """Makes packets of consecutive stretches of events; their stamps always rise."""

    def __init__(self) -> None:
        self._index = 0
        self._stamp_ns: int | None = None

    def note_loss(self) -> None:
        """Leave a gap in the running numbers: an unknown number of events is missing."""
        self._index = (self._index + 1) % INDEX_MODULUS

    def packets(self, events: SensorEvents, end_ns: int) -> list[EventPacket]:
        """Packets of the next stretch; the last one ends with it, without events if need be.

        An event dated before the end of the last packet is moved behind it, unless the whole
        stretch is a second or more before: then the camera has started again.

        Parameters
        ----------
        events
            The events; their times are those of the packets, ns, and need not be in order.
        end_ns
            Time up to which these are all events, ns.
        """
        if self._stamp_ns is not None and end_ns < self._stamp_ns - _RESTART_NS:
            self._stamp_ns = None
        earliest = end_ns if self._stamp_ns is None else self._stamp_ns + 1
        dates = events.t if self._stamp_ns is None else np.maximum(events.t, earliest)
        found = []
        while dates.size:
            first = int(dates.min())
            part = dates <= first + _LONGEST_NS
            stamp_ns = int(dates[part].max())
            if part.all() and end_ns - first <= _LONGEST_NS:
                stamp_ns = max(stamp_ns, end_ns)
            records = _records(events.take(part), dates[part], stamp_ns)
            found.append(self._packet(records, stamp_ns))
            events, dates = events.take(~part), dates[~part]
        if not found or found[-1].stamp_ns < end_ns:
            found.append(self._packet(NO_EVENTS, max(end_ns, earliest)))
        return found

    def _packet(self, records: NDArray[np.void], stamp_ns: int) -> EventPacket:
        numbers = self._index + np.arange(len(records), dtype=np.uint64)
        if len(records):
            records['index'] = numbers % INDEX_MODULUS
        self._index = (self._index + len(records)) % INDEX_MODULUS
        self._stamp_ns = stamp_ns
        return EventPacket(stamp_ns=stamp_ns, events=records)


def _records(events: SensorEvents, dates: NDArray[np.int64], stamp_ns: int) -> NDArray[np.void]:
    """Records sorted by (t, y, x), OFF before ON.

    All that an event is fits one word of 64 bits, so that a plain sort puts them in order.
    """
    first = int(dates.min())
    key = (dates - first).astype(np.uint64) << 34
    key |= events.y.astype(np.uint64) << 18
    key |= events.x.astype(np.uint64) << 2
    key |= events.p.astype(np.uint64) << 1
    if events.noise is not None:
        key |= events.noise.astype(np.uint64) & 1
    key.sort()
    records = np.zeros(len(key), EVENT_DTYPE if events.noise is None else LABELLED_EVENT_DTYPE)
    records['t'] = (key >> 34).astype(np.int64) + (first - stamp_ns)
    records['y'] = key >> 18 & 0xFFFF
    records['x'] = key >> 2 & 0xFFFF
    records['polarity'] = (key >> 1 & 1).astype(np.int8) * 2 - 1
    records['sign'] = 1
    if events.noise is not None:
        records['noise'] = key & 1
    return records
