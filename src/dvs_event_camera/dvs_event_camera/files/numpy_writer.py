"""Writers of NumPy's files that hold a stretch in memory at a time."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy_format

from dvs_event_camera.files.trigger_file import TriggerWriter
from dvs_event_camera.files.writer_form import WriterForm
from dvs_event_camera.streams.sensor_events import NO_TRIGGERS, SensorEvents, joined, no_events

_TYPES = {'x': '<u2', 'y': '<u2', 't': '<i8', 'p': 'u1', 'noise': 'u1'}
_HEAD_BYTES = 192


class NpzWriter:
    """Writes an archive with the arrays x, y, t (ns), p, and noise where there are labels.

    The arrays grow in temporary files, since an archive takes one after the other.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.
    """

    def __init__(self, path: Path, form: WriterForm) -> None:
        self._form = form
        self._file = path.open('wb')
        names = ('x', 'y', 't', 'p', *(('noise',) if form.labelled else ()))
        self._columns: dict[str, IO[bytes]] = {}
        for name in names:
            self._columns[name] = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115
        self._count = 0
        self._triggers = NO_TRIGGERS

    def add(self, events: SensorEvents) -> None:
        """Keep a stretch; see `EventWriter.add`."""
        for name, file in self._columns.items():
            file.write(np.ascontiguousarray(getattr(events, name), _TYPES[name]).data)
        self._count += len(events)
        if len(events.triggers):
            parts = [no_events(self._triggers), no_events(events.triggers)]
            self._triggers = joined(parts).triggers

    def close(self) -> None:
        """Write the archive; see `EventWriter.close`."""
        with self._file, zipfile.ZipFile(self._file, 'w', zipfile.ZIP_DEFLATED) as archive:
            for name, column in self._columns.items():
                with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                    member.write(_head(np.dtype(_TYPES[name]), self._count))
                    column.seek(0)
                    shutil.copyfileobj(column, member)
                column.close()
            small = {
                'width': np.int64(self._form.width),
                'height': np.int64(self._form.height),
                'trigger_t': self._triggers.t,
                'trigger_source': self._triggers.source,
                'trigger_rising': self._triggers.rising,
            }
            for name, values in small.items():
                with archive.open(f'{name}.npy', 'w') as member:
                    npy_format.write_array(member, np.asanyarray(values))


class TonicWriter:
    """Writes an NPY file of records as the library tonic has events in memory.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.
    """

    def __init__(self, path: Path, form: WriterForm) -> None:
        kinds = {'noise': '?', 'ns': '<u2'}
        fields = [('x', '<i2'), ('y', '<i2'), ('t', '<i8'), ('p', '?')]
        self._extra = form.extra_columns()
        self._dtype = np.dtype([*fields, *((name, kinds[name]) for name in self._extra)])
        self._count = 0
        self._triggers = TriggerWriter(path)
        self._file = path.open('wb')
        self._file.write(_head(self._dtype, 0))

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`."""
        records = np.zeros(len(events), self._dtype)
        records['t'], rest = np.divmod(events.t, 1000)
        records['x'], records['y'], records['p'] = events.x, events.y, events.p
        for name in self._extra:
            records[name] = rest if name == 'ns' else events.noise
        self._file.write(records.tobytes())
        self._count += len(events)
        self._triggers.add(events.triggers)

    def close(self) -> None:
        """Write the number of events; see `EventWriter.close`."""
        self._file.seek(0)
        self._file.write(_head(self._dtype, self._count))
        self._file.close()


def _head(dtype: np.dtype[np.generic], count: int) -> bytes:
    """Head of an NPY file, of the same size whatever the count."""
    descr = npy_format.dtype_to_descr(dtype)
    text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': ({count},), }}"
    size = _HEAD_BYTES if len(text) < _HEAD_BYTES - 11 else 2 * _HEAD_BYTES
    body = text.ljust(size - 11) + '\n'
    return npy_format.magic(1, 0) + len(body).to_bytes(2, 'little') + body.encode('ascii')
