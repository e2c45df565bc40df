"""Events in the files of NumPy, read piece by piece.

An NPZ archive holds the arrays x, y, t, p: t in ns, or in microseconds where there is an array
`ns` with what is beyond them. An NPY file holds records with the fields x, y, t, p, t in
microseconds, as the library tonic has them in memory.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import (
    STRETCH_EVENTS,
    Recording,
    Stretch,
    pixel_numbers,
    stretch_of,
)
from dvs_event_camera.files.trigger_file import read_triggers
from dvs_event_camera.streams.sensor_events import NO_TRIGGERS, SensorEvents, Triggers, no_events

_COLUMNS = ('x', 'y', 't', 'p')


class _Column:
    """An array of one dimension in an open .npy file, read from its beginning on."""

    def __init__(self, file: IO[bytes]) -> None:
        version = npy_format.read_magic(file)
        read_head = (
            npy_format.read_array_header_1_0
            if version == (1, 0)
            else npy_format.read_array_header_2_0
        )
        shape, _, self.dtype = read_head(file)
        if len(shape) != 1 or self.dtype.hasobject:
            raise ValueError(f'an array has shape {shape} and type {self.dtype}')
        self.length: int = shape[0]
        self._file = file

    def take(self, count: int) -> NDArray[Any]:
        """Next `count` entries; raises EOFError if they are not there."""
        size = count * self.dtype.itemsize
        data = self._file.read(size)
        if len(data) < size:
            raise EOFError('ends too early')
        return np.frombuffer(data, self.dtype)


def npz_recording(path: Path) -> Recording:
    """Recording of an NPZ archive.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If it is no archive, or lacks one of the arrays.
    """
    try:
        with np.load(path) as archive:
            names = set(archive.files)
            size = [int(archive[name]) if name in names else 0 for name in ('width', 'height')]
    # Here and below: archives and headers are parsed by others, who raise whatever they meet.
    except Exception as error:
        raise ParameterError('file', path, f'is no NPZ archive: {error}') from None
    if not set(_COLUMNS) <= names:
        raise ParameterError('file', path, f'lacks arrays of {_COLUMNS}; it holds {sorted(names)}')
    return Recording(
        path=path,
        encoding='npz',
        width=size[0],
        height=size[1],
        whole_microseconds=False,
        read=lambda: _stretches(path, names),
    )


def _stretches(path: Path, names: set[str]) -> Iterator[Stretch]:
    wanted = [name for name in (*_COLUMNS, 'noise', 'ns') if name in names]
    with ExitStack() as stack:
        try:
            triggers = _triggers_of(path, names)
            if len(triggers):
                yield stretch_of(no_events(triggers))
            archive = stack.enter_context(zipfile.ZipFile(path))
            columns = {
                name: _Column(stack.enter_context(archive.open(f'{name}.npy'))) for name in wanted
            }
            left = min(column.length for column in columns.values())
            while left:
                count = min(left, STRETCH_EVENTS)
                yield stretch_of(_events({n: c.take(count) for n, c in columns.items()}))
                left -= count
        except Exception as error:
            raise DamagedFile(path, f'is damaged: {error}') from None


def _events(column: dict[str, NDArray[Any]]) -> SensorEvents:
    t = column['t'].astype(np.int64)
    if 'ns' in column:
        t = t * 1000 + column['ns']
    return SensorEvents(
        t=t,
        x=pixel_numbers(column['x']),
        y=pixel_numbers(column['y']),
        p=(column['p'] > 0).astype(np.uint8),
        noise=column['noise'].astype(np.uint8) if 'noise' in column else None,
    )


def _triggers_of(path: Path, names: set[str]) -> Triggers:
    if 'trigger_t' not in names:
        return NO_TRIGGERS
    with np.load(path) as archive:
        return Triggers(
            t=archive['trigger_t'],
            source=archive['trigger_source'],
            rising=archive['trigger_rising'],
        )


def npy_recording(path: Path) -> Recording:
    """Recording of an NPY file of records.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If it is no NPY file, or its records lack one of the fields.
    """
    try:
        with path.open('rb') as file:
            fields = _Column(file).dtype.names or ()
    except Exception as error:
        raise ParameterError('file', path, f'is no NPY file of records: {error}') from None
    if not set(_COLUMNS) <= set(fields):
        raise ParameterError('file', path, f'lacks fields of {_COLUMNS}; it has {fields}')
    return Recording(
        path=path,
        encoding='npy',
        width=0,
        height=0,
        whole_microseconds='ns' not in fields,
        read=lambda: _records(path),
    )


def _records(path: Path) -> Iterator[Stretch]:
    triggers = read_triggers(path)
    if len(triggers):
        yield stretch_of(no_events(triggers))
    with path.open('rb') as file:
        array = _Column(file)
        left = array.length
        while left:
            try:
                records = array.take(min(left, STRETCH_EVENTS))
                column = {name: records[name] for name in records.dtype.names or ()}
                column.setdefault('ns', np.zeros(len(records), np.int64))
                events = _events(column)
            except (EOFError, ValueError) as error:
                raise DamagedFile(path, str(error)) from None
            left -= len(records)
            yield stretch_of(events)
