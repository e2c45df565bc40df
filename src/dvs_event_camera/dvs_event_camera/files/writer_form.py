"""What a writer of events is and what it needs before the first event."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dvs_event_camera.streams.sensor_events import SensorEvents


@dataclass(frozen=True, slots=True, kw_only=True)
class WriterForm:
    """What the events that are to be written are like.

    Parameters
    ----------
    width
        Columns of the sensor; 0 where that is not known.
    height
        Rows of the sensor; 0 where that is not known.
    whole_microseconds
        Whether all times are whole microseconds.
    labelled
        Whether the events carry noise labels.
    """

    width: int
    height: int
    whole_microseconds: bool
    labelled: bool

    def extra_columns(self, *, exact_time: bool = False) -> tuple[str, ...]:
        """Columns beside t, x, y and p: `noise`, and `ns` for what is beyond microseconds.

        Parameters
        ----------
        exact_time
            Whether the column t has the nanoseconds already.
        """
        noise = ('noise',) if self.labelled else ()
        return noise if exact_time or self.whole_microseconds else (*noise, 'ns')


class EventWriter(Protocol):
    """Takes events, stretch after stretch."""

    def add(self, events: SensorEvents) -> None:
        """Write a stretch and its triggers.

        Parameters
        ----------
        events
            The events.
        """

    def close(self) -> None:
        """Write what is left."""
