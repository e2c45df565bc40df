"""Counts lost events by the running number that every event carries."""

from __future__ import annotations

from dvs_common.wire.events import INDEX_MODULUS, EventPacket


class IndexWatch:
    """Follows the running event number through the packets of one camera.

    A packet stamped before the previous one is a restart of the camera, not a loss.
    """

    def __init__(self) -> None:
        self.events = 0
        self.on_events = 0
        self.lost = 0
        self.gaps = 0
        self.restarts = 0
        self.first_index: int | None = None
        self._next: int | None = None
        self._stamp_ns: int | None = None

    def take(self, packet: EventPacket) -> int:
        """Count one packet; return the number of events lost before it.

        Parameters
        ----------
        packet
            Next packet.
        """
        if self._stamp_ns is not None and packet.stamp_ns < self._stamp_ns:
            self.restarts += 1
            self._next = None
        self._stamp_ns = packet.stamp_ns
        events = packet.events
        if len(events) == 0:
            return 0
        first = int(events['index'][0])
        if self.first_index is None:
            self.first_index = first
        lost = 0 if self._next is None else (first - self._next) % INDEX_MODULUS
        self._next = (int(events['index'][-1]) + 1) % INDEX_MODULUS
        self.events += len(events)
        self.on_events += int((events['polarity'] > 0).sum())
        self.lost += lost
        self.gaps += lost > 0
        return lost
