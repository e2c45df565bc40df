"""Writer of HDF5 files in the layout of DSEC; see `hdf5_file` for what it adds."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_event_camera.files.writer_form import WriterForm
from dvs_event_camera.streams.sensor_events import SensorEvents

_CHUNK = 2**16
# Times of a longer recording count from its first event, microseconds.
_MOST_WITHOUT_OFFSET = 3_600_000_000
_TYPES = {'t': 'i8', 'x': 'u2', 'y': 'u2', 'p': 'u1', 'noise': 'u1', 'ns': 'u2'}
_TRIGGER_TYPES = {'t': 'i8', 'source': 'u1', 'rising': 'u1'}


class Hdf5Writer:
    """Writes events, compressed by what every HDF5 library has.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.

    Raises
    ------
    ParameterError
        If h5py is not installed.
    """

    def __init__(self, path: Path, form: WriterForm) -> None:
        try:
            h5py = import_module('h5py')
        except ImportError:
            raise ParameterError('format', 'hdf5', 'needs the Python package h5py') from None
        self._file = h5py.File(path, 'w')
        if form.width and form.height:
            self._file.attrs['width'], self._file.attrs['height'] = form.width, form.height
            self._file.attrs['geometry'] = f'{form.width}x{form.height}'
        self._columns = ('t', 'x', 'y', 'p', *form.extra_columns())
        for name in self._columns:
            self._create(f'events/{name}', _TYPES[name])
        for name, kind in _TRIGGER_TYPES.items():
            self._create(f'triggers/{name}', kind)
        self._create('ms_to_idx', 'u8')
        self._offset: int | None = None

    def _create(self, name: str, kind: str) -> None:
        self._file.create_dataset(
            name,
            shape=(0,),
            maxshape=(None,),
            dtype=kind,
            chunks=(_CHUNK,),
            compression='gzip',
            compression_opts=1,
            shuffle=True,
        )

    def _append(self, name: str, values: NDArray[np.generic]) -> None:
        data = self._file[name]
        size = len(data)
        data.resize((size + len(values),))
        data[size:] = values

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`."""
        whole, rest = np.divmod(events.t, 1000)
        if self._offset is None and len(events):
            self._offset = int(whole[0]) if whole[0] > _MOST_WITHOUT_OFFSET else 0
        since = whole - (self._offset or 0)
        self._index_milliseconds(since)
        values = {
            't': since,
            'ns': rest,
            'x': events.x,
            'y': events.y,
            'p': events.p,
            'noise': events.noise,
        }
        for name in self._columns:
            column = values[name]
            assert column is not None
            self._append(f'events/{name}', column)
        for name in _TRIGGER_TYPES:
            self._append(f'triggers/{name}', getattr(events.triggers, name))

    def _index_milliseconds(self, since: NDArray[np.int64]) -> None:
        """Note the first event of each millisecond that has begun."""
        known = len(self._file['ms_to_idx'])
        last = int(since.max()) // 1000 if since.size else -1
        if last >= known:
            begins = 1000 * np.arange(known, last + 1)
            first = np.searchsorted(np.maximum.accumulate(since), begins)
            self._append('ms_to_idx', first + len(self._file['events/t']))

    def close(self) -> None:
        """Close the file; see `EventWriter.close`."""
        self._file['t_offset'] = np.int64(self._offset or 0)
        self._file.close()
