"""What one wants to know of a stream of events: rate, share of ON, losses, delay, jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.events import EventPacket
from dvs_common.wire.index_watch import IndexWatch, Order

# Events a second that are better read one by one than by the million.
_FEW = 1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamReport:
    """Statistics of a stretch of a stream.

    Parameters
    ----------
    messages
        Packets received.
    events
        Events received, those of a repeated packet once.
    on_events
        Those with polarity +1.
    lost_events
        Events missing according to the running index.
    unordered_events
        Events earlier than the one before them.
    restarts
        Packets with a stamp or an index before the last one: the camera, or its clock, started
        again.
    repeated
        Packets received twice.
    seconds
        Time that the packets cover, s.
    delay_s
        Mean of reception minus stamp, s; NaN if the stamps are in another clock.
    jitter_s
        Standard deviation of the intervals between receptions, s; NaN with fewer than three.
    """

    messages: int
    events: int
    on_events: int
    lost_events: int
    unordered_events: int
    restarts: int
    repeated: int
    seconds: float
    delay_s: float
    jitter_s: float

    def __str__(self) -> str:
        """One line."""
        if not self.messages:
            return 'no packet heard'
        share = f'{100 * self.on_events / self.events:.1f}' if self.events else '-'
        restarts = f', {self.restarts} restarts' if self.restarts else ''
        restarts += f', {self.repeated} packets twice' if self.repeated else ''
        delay = (
            'delay unknown (stamps are of another clock)'
            if math.isnan(self.delay_s)
            else f'delay {self.delay_s * 1e3:.2f} ms'
        )
        jitter = '-' if math.isnan(self.jitter_s) else f'{self.jitter_s * 1e3:.2f} ms'
        return (
            f'{self.messages} packets, {self.events} events in {self.seconds:.3f} s: '
            f'{self._rate()}, {share} % ON, {self.lost_events} lost, '
            f'{self.unordered_events} out of order{restarts}, {delay}, jitter {jitter}'
        )

    def _rate(self) -> str:
        if not self.seconds > 0:
            return '- events/s'
        rate = self.events / self.seconds
        return f'{rate:.1f} events/s' if rate < _FEW else f'{rate * 1e-6:.3f} Mev/s'


class StreamStatistics:
    """Collects statistics packet by packet."""

    # A delay beyond this means that stamps and receptions are in different clocks.
    _SAME_CLOCK_S = 3600.0

    def __init__(self) -> None:
        self._index = IndexWatch()
        self._last_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Begin a new stretch; order and index go on."""
        self._messages = self._events = self._on = self._lost = self._unordered = 0
        self._restarts = self._repeated = self._covered_ns = 0
        self._delays: list[float] = []
        self._receptions: list[float] = []

    def add(self, packet: EventPacket, received_s: float | None = None) -> None:
        """Take a packet.

        Parameters
        ----------
        packet
            The packet.
        received_s
            When it was received, s; None if that is not known.
        """
        self._messages += 1
        if self._last_ns is not None and packet.stamp_ns < self._last_ns:
            self._last_ns = None
        step = self._index.take(packet)
        self._lost += step.lost
        self._restarts += step.order is Order.GONE_BACK
        self._repeated += step.order is Order.REPEATED
        if received_s is not None:
            self._receptions.append(received_s)
            self._delays.append(received_s - as_seconds(packet.stamp_ns))
        if len(packet.events) and step.order is not Order.REPEATED:
            self._count(packet)
        begin_ns = self._first_ns(packet) if self._last_ns is None else self._last_ns
        self._covered_ns += packet.stamp_ns - begin_ns
        self._last_ns = packet.stamp_ns

    def _first_ns(self, packet: EventPacket) -> int:
        return packet.stamp_ns + (int(packet.events['t'][0]) if len(packet.events) else 0)

    def _count(self, packet: EventPacket) -> None:
        events = packet.events
        times = events['t'].astype(np.int64)
        self._events += len(events)
        self._on += int(np.count_nonzero(events['polarity'] > 0))
        self._unordered += int(np.count_nonzero(np.diff(times) < 0))
        if self._last_ns is not None and packet.stamp_ns + int(times[0]) < self._last_ns:
            self._unordered += 1

    def report(self) -> StreamReport:
        """Statistics since the last reset."""
        delay = float(np.mean(self._delays)) if self._delays else math.nan
        intervals = np.diff(self._receptions)
        return StreamReport(
            messages=self._messages,
            events=self._events,
            on_events=self._on,
            lost_events=self._lost,
            unordered_events=self._unordered,
            restarts=self._restarts,
            repeated=self._repeated,
            seconds=as_seconds(self._covered_ns),
            delay_s=delay if abs(delay) < self._SAME_CLOCK_S else math.nan,
            jitter_s=float(np.std(intervals)) if intervals.size > 1 else math.nan,
        )
