"""Shows packets up to a limit: the heart of `show_events`, live or from a bag."""

from __future__ import annotations

from collections.abc import Sequence

from dvs_common.nanoseconds import as_nanoseconds
from dvs_common.wire.events import EventPacket
from dvs_event_camera.streams.event_sinks import EventSink
from dvs_event_camera.streams.stream_statistics import StreamStatistics


class EventShow:
    """Hands packets to sinks, up to a limit, and keeps statistics.

    Parameters
    ----------
    sinks
        Where events go.
    limit
        Number of events after which it is done; None for no limit.
    seconds
        Time of events after which it is done, s; None for no limit.
    """

    def __init__(
        self, sinks: Sequence[EventSink], limit: int | None = None, seconds: float | None = None
    ) -> None:
        self._sinks = sinks
        self._left = limit
        self._span_ns = None if seconds is None else as_nanoseconds(seconds)
        self._first_ns: int | None = None
        self.statistics = StreamStatistics()
        self.done = limit == 0

    def add(self, packet: EventPacket, received_s: float) -> None:
        """Take a packet.

        Parameters
        ----------
        packet
            The packet.
        received_s
            When it was received, s.
        """
        if self.done:
            return
        self._first_ns = packet.stamp_ns if self._first_ns is None else self._first_ns
        if self._span_ns is not None and packet.stamp_ns - self._first_ns > self._span_ns:
            self.done = True
            return
        if self._left is not None:
            packet = EventPacket(stamp_ns=packet.stamp_ns, events=packet.events[: self._left])
            self._left -= len(packet.events)
            self.done = self._left == 0
        self.statistics.add(packet, received_s)
        for sink in self._sinks:
            sink.add(packet)
