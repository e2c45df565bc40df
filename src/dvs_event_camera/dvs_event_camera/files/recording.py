"""One interface to every recording of events: a description, and its events in stretches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.index_watch import IndexStep, Order
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.streams.sensor_events import SensorEvents

# Events that a reader holds at a time, so that a file of any size fits the memory.
STRETCH_EVENTS = 2**19
_IN_ORDER = IndexStep(order=Order.IN_ORDER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Events that were recorded together, a message or a piece of a file.

    Parameters
    ----------
    events
        The events, in the time of the sensor.
    end_ns
        Sensor time up to which they are all of them, ns.
    stamp_ns
        Stamp in the message's header, ROS time, ns; None in a file without messages.
    received_ns
        When the message was recorded, ns; None in a file without messages.
    sequence
        Running number of the driver's message, if it has one.
    step
        What the running numbers of the events show, if they have any.
    """

    events: SensorEvents
    end_ns: int
    stamp_ns: int | None = None
    received_ns: int | None = None
    sequence: int | None = None
    step: IndexStep = _IN_ORDER


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A file or bag with events.

    Parameters
    ----------
    path
        Where it is.
    encoding
        How the events are written down: `evt3`, `libcaer_cmp`, `aedat4`, `hdf5`, ...
    width
        Columns of the sensor; 0 where the recording does not hold it.
    height
        Rows of the sensor; 0 where the recording does not hold it.
    whole_microseconds
        Whether all times are whole microseconds, as a sensor counts them.
    read
        Begins to read: yields the stretches in order, and raises `DamagedFile` at the end if not
        all could be read.
    """

    path: Path
    encoding: str
    width: int
    height: int
    whole_microseconds: bool
    read: Callable[[], Iterator[Stretch]]


def stretch_of(events: SensorEvents) -> Stretch:
    """Stretch of a file without messages.

    Parameters
    ----------
    events
        A piece of the file.
    """
    return Stretch(events=events, end_ns=int(events.t[-1]) if len(events) else 0)


def pixel_numbers(values: NDArray[Any]) -> NDArray[np.uint16]:
    """Columns or rows of pixels, as 16 bits.

    Parameters
    ----------
    values
        Numbers of any type, shape (k,).

    Raises
    ------
    ValueError
        If one of them can be no column or row.
    """
    possible = are_pixel_numbers(values)
    if not possible.all():
        raise ValueError(f'an event has the column or row {values[~possible][0]}')
    return values.astype(np.uint16)


def are_pixel_numbers(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Which numbers are columns or rows that an event can name, shape (k,).

    Parameters
    ----------
    values
        Numbers of any type, shape (k,).
    """
    return np.asarray((values >= 0) & (values < 2**16))


def measured_size(recording: Recording) -> tuple[int, int]:
    """Columns and rows of the sensor: as in the recording, or the least that hold all events.

    Parameters
    ----------
    recording
        The recording; read once through where it does not hold them.
    """
    if recording.width and recording.height:
        return recording.width, recording.height
    width = height = 0
    try:
        for stretch in recording.read():
            if len(stretch.events):
                width = max(width, int(stretch.events.x.max()) + 1)
                height = max(height, int(stretch.events.y.max()) + 1)
    except DamagedFile:
        # A reader that goes on meets it again.
        pass
    return width, height
