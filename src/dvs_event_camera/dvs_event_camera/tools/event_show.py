"""Shows stretches of events up to a limit: the heart of `show_events`, live or from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dvs_common.nanoseconds import as_nanoseconds
from dvs_event_camera.files.recording import Stretch
from dvs_event_camera.files.writer_form import EventWriter
from dvs_event_camera.tools.stream_statistics import StreamStatistics


class EventShow:
    """Hands stretches to writers, up to a limit, and keeps statistics.

    Parameters
    ----------
    writers
        Where events go.
    limit
        Number of events after which it is done; None for no limit.
    seconds
        Time of events after which it is done, s; None for no limit.
    """

    def __init__(
        self,
        writers: Sequence[EventWriter],
        limit: int | None = None,
        seconds: float | None = None,
    ) -> None:
        self._writers = writers
        self._left = limit
        self._span_ns = None if seconds is None else as_nanoseconds(seconds)
        self._first_ns: int | None = None
        self.statistics = StreamStatistics()
        self.done = limit == 0

    def add(self, stretch: Stretch) -> None:
        """Take a stretch.

        Parameters
        ----------
        stretch
            Events that were recorded together.
        """
        if self.done:
            return
        if self._span_ns is not None:
            stretch = self._within_span(stretch, self._span_ns)
        if self._left is not None:
            events = stretch.events.take(slice(self._left))
            self._left -= len(events)
            self.done = self.done or self._left == 0
            stretch = replace(stretch, events=events)
        self.statistics.add(stretch)
        for writer in self._writers:
            writer.add(stretch.events)

    def _within_span(self, stretch: Stretch, span_ns: int) -> Stretch:
        events = stretch.events
        if self._first_ns is None:
            self._first_ns = int(events.t[0]) if len(events) else stretch.end_ns
        end_ns = self._first_ns + span_ns
        if stretch.end_ns <= end_ns:
            return stretch
        self.done = True
        return replace(stretch, events=events.take(events.t <= end_ns), end_ns=end_ns)
