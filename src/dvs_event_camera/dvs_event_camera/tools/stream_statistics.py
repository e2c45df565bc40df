"""Statistics of a stream of events: rate, share of ON, losses, delay, jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.index_watch import Order
from dvs_event_camera.files.recording import Stretch
from dvs_event_camera.streams.sensor_events import SensorEvents

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
            return 'no packet received'
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
        self._last_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Count anew; order goes on."""
        self._messages = self._events = self._on = self._lost = self._unordered = 0
        self._restarts = self._repeated = self._covered_ns = 0
        self._delays: list[float] = []
        self._receptions: list[float] = []

    def add(self, stretch: Stretch) -> None:
        """Take a stretch.

        Parameters
        ----------
        stretch
            Events that were recorded together.
        """
        self._messages += 1
        order = stretch.step.order
        gone_back = self._last_ns is not None and stretch.end_ns < self._last_ns
        if gone_back:
            self._last_ns = None
        self._lost += stretch.step.lost
        self._restarts += gone_back or order is Order.GONE_BACK
        self._repeated += order is Order.REPEATED
        if stretch.received_ns is not None:
            self._receptions.append(as_seconds(stretch.received_ns))
            if stretch.stamp_ns is not None:
                self._delays.append(as_seconds(stretch.received_ns - stretch.stamp_ns))
        begin_ns = int(stretch.events.t[0]) if len(stretch.events) else stretch.end_ns
        if order is not Order.REPEATED:
            self._count(stretch.events)
        self._covered_ns += stretch.end_ns - (begin_ns if self._last_ns is None else self._last_ns)
        self._last_ns = stretch.end_ns

    def _count(self, events: SensorEvents) -> None:
        self._events += len(events)
        self._on += int(np.count_nonzero(events.p))
        self._unordered += int(np.count_nonzero(events.t[1:] < events.t[:-1]))
        if self._last_ns is not None and len(events) and events.t[0] < self._last_ns:
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
