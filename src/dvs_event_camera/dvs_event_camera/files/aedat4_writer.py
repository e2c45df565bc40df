"""Writer of AEDAT4 files: LZ4, and a table of the packets at the end.

aestream takes no other form; DV's tools seek by the table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_event_camera.files.aedat4 import (
    GENERATOR_FALLING,
    GENERATOR_RISING,
    SIGNAL_FALLING,
    SIGNAL_RISING,
)
from dvs_event_camera.files.aedat4_bytes import (
    EVENT_DTYPE,
    PACKET_HEAD,
    PacketPlace,
    events_packet,
    file_head,
    packet_table,
    triggers_packet,
)
from dvs_event_camera.files.writer_form import WriterForm
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers

_EVENTS, _TRIGGERS = 0, 1
# DV's tools hold a packet at a time.
_PACKET_EVENTS = 2**16
_LARGEST_COORDINATE = 2**15 - 1
# Kind of edge by its input and whether it rises.
_KINDS = np.array(
    [[SIGNAL_FALLING, SIGNAL_RISING], [GENERATOR_FALLING, GENERATOR_RISING]], np.uint8
)


class Aedat4Writer:
    """Writes events and triggers; times are rounded down to microseconds.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.

    Raises
    ------
    ParameterError
        If the events carry labels, which have no place in this format, or the size of the sensor
        is not known.
    """

    def __init__(self, path: Path, form: WriterForm) -> None:
        if form.labelled:
            raise ParameterError(
                'format', 'aedat4', 'has no place for noise labels; npz, hdf5, csv and text have'
            )
        if not 0 < max(form.width, form.height) <= _LARGEST_COORDINATE:
            raise ParameterError(
                'size', f'{form.width}x{form.height}', 'must be that of the sensor: WIDTHxHEIGHT'
            )
        self._form = form
        self._places: list[PacketPlace] = []
        self._file = path.open('wb')
        self._write_head(-1)

    def _write_head(self, table_at: int) -> None:
        form = self._form
        head = file_head(
            width=form.width,
            height=form.height,
            events=_EVENTS,
            triggers=_TRIGGERS,
            table_at=table_at,
        )
        self._file.write(head)

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`."""
        records = np.zeros(len(events), EVENT_DTYPE)
        records['t'] = events.t // 1000
        records['x'], records['y'], records['on'] = events.x, events.y, events.p
        for start in range(0, len(records), _PACKET_EVENTS):
            piece = records[start : start + _PACKET_EVENTS]
            self._add_packet(_EVENTS, piece['t'], events_packet(_EVENTS, piece))
        if len(events.triggers):
            self._add_triggers(events.triggers)

    def _add_triggers(self, triggers: Triggers) -> None:
        if triggers.source.max() >= len(_KINDS):
            raise ParameterError(
                'format', 'aedat4', f'has no place for trigger input {triggers.source.max()}'
            )
        kinds = _KINDS[triggers.source, triggers.rising]
        t = triggers.t // 1000
        self._add_packet(_TRIGGERS, t, triggers_packet(_TRIGGERS, t, kinds))

    def _add_packet(self, stream: int, t: NDArray[np.int64], packet: bytes) -> None:
        place = PacketPlace(
            stream=stream,
            place=self._file.tell() + PACKET_HEAD.size,
            size=len(packet) - PACKET_HEAD.size,
            count=len(t),
            first=int(t[0]),
            last=int(t[-1]),
        )
        self._file.write(packet)
        self._places.append(place)

    def close(self) -> None:
        """Write the table and close the file; see `EventWriter.close`."""
        with self._file:
            table_at = self._file.tell()
            self._file.write(packet_table(self._places))
            self._file.seek(0)
            self._write_head(table_at)
