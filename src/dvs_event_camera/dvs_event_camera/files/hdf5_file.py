"""HDF5 files in the layouts of DSEC, Metavision, v2e and of event_utils, by h5py.

| | columns | time |
|---|---|---|
| DSEC | `events/x`, `y`, `t`, `p` | microseconds after `t_offset` |
| Metavision | `CD/events`: x, y, p, t; `EXT_TRIGGER/events`: p, t, id | microseconds |
| v2e | `events`, shape (E, 4): t, x, y, p | microseconds |
| event_utils | `events/xs`, `ys`, `ts`, `ps` | seconds |

Ours is DSEC's with `events/noise`, `events/ns` (what is beyond whole microseconds) and
`triggers/t`, `source`, `rising`, each where there is something to keep.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import (
    STRETCH_EVENTS,
    Recording,
    Stretch,
    pixel_numbers,
    stretch_of,
)
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers, no_events

Slice = Callable[[Any, slice], SensorEvents]


def hdf5_recording(path: Path) -> Recording:
    """Recording of an HDF5 file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If it is no HDF5 file, or in none of the layouts that are known.
    """
    with _opened(path) as file:
        try:
            layout, names = _layout_of(file), sorted(file)
            width, height = _size_of(file)
            exact = 'ns' in file['events'] if _is_group(file, 'events') else False
        # The library raises whatever it meets in a damaged file.
        except Exception as error:
            raise ParameterError('file', path, _reason(error)) from None
        if layout is None:
            raise ParameterError('file', path, f'has none of the known layouts; it holds {names}')
        seconds = layout is _event_utils_slice
    return Recording(
        path=path,
        encoding='hdf5',
        width=width,
        height=height,
        whole_microseconds=not (exact or seconds),
        read=lambda: _stretches(path),
    )


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        h5py = import_module('h5py')
    except ImportError:
        raise ParameterError('file', path, 'needs the Python package h5py') from None
    with suppress(ImportError):
        # Brings the filters of recordings that are compressed otherwise, where it is installed.
        import_module('hdf5plugin')
    try:
        file = h5py.File(path, 'r')
    except OSError as error:
        raise ParameterError('file', path, f'is no HDF5 file that can be read: {error}') from None
    with file:
        yield file


def _is_group(file: Any, name: str) -> bool:
    return name in file and hasattr(file[name], 'keys')


def _layout_of(file: Any) -> Slice | None:
    if _is_group(file, 'events'):
        names = set(file['events'])
        if {'x', 'y', 't', 'p'} <= names:
            return _dsec_slice
        if {'xs', 'ys', 'ts', 'ps'} <= names:
            return _event_utils_slice
    elif 'events' in file and file['events'].ndim == 2 and file['events'].shape[1] == 4:
        return _v2e_slice
    if _is_group(file, 'CD') and 'events' in file['CD']:
        return _metavision_slice
    return None


def _stretches(path: Path) -> Iterator[Stretch]:
    with _opened(path) as file:
        try:
            layout = _layout_of(file)
            assert layout is not None
            triggers = _triggers_of(file)
            if len(triggers):
                yield stretch_of(no_events(triggers))
            for start in range(0, _length(file), STRETCH_EVENTS):
                yield stretch_of(layout(file, slice(start, start + STRETCH_EVENTS)))
        except Exception as error:
            raise DamagedFile(path, _reason(error)) from None


def _reason(error: Exception) -> str:
    text = str(error)
    if 'required filter' in text or 'plugin' in text:
        return f'is compressed by a filter that h5py lacks ({text}); try pip install hdf5plugin'
    return f'is damaged: {text}'


def _length(file: Any) -> int:
    if _is_group(file, 'events'):
        group = file['events']
        return int(min(group[name].shape[0] for name in group if name in _COLUMNS))
    return int((file['CD/events'] if 'CD' in file else file['events']).shape[0])


_COLUMNS = ('x', 'y', 't', 'p', 'xs', 'ys', 'ts', 'ps')


def _dsec_slice(file: Any, part: slice) -> SensorEvents:
    group = file['events']
    offset = int(file['t_offset'][()]) if 't_offset' in file else 0
    t = (group['t'][part].astype(np.int64) + offset) * 1000
    if 'ns' in group:
        t += group['ns'][part]
    noise = group['noise'][part].astype(np.uint8) if 'noise' in group else None
    return _columns(t, group['x'][part], group['y'][part], group['p'][part], noise)


def _event_utils_slice(file: Any, part: slice) -> SensorEvents:
    group = file['events']
    t = np.rint(group['ts'][part].astype(np.float64) * NANOSECONDS).astype(np.int64)
    return _columns(t, group['xs'][part], group['ys'][part], group['ps'][part])


def _v2e_slice(file: Any, part: slice) -> SensorEvents:
    t, x, y, p = file['events'][part].astype(np.int64).T
    return _columns(t * 1000, x, y, p)


def _metavision_slice(file: Any, part: slice) -> SensorEvents:
    records = file['CD/events'][part]
    return _columns(records['t'].astype(np.int64) * 1000, records['x'], records['y'], records['p'])


def _columns(
    t: NDArray[np.int64], x: Any, y: Any, p: Any, noise: NDArray[np.uint8] | None = None
) -> SensorEvents:
    return SensorEvents(
        t=t,
        x=pixel_numbers(np.asarray(x)),
        y=pixel_numbers(np.asarray(y)),
        p=(np.asarray(p) > 0).astype(np.uint8),
        noise=noise,
    )


def _triggers_of(file: Any) -> Triggers:
    if _is_group(file, 'triggers'):
        group = file['triggers']
        return _edges(group['t'][()], group['source'][()], group['rising'][()])
    if _is_group(file, 'EXT_TRIGGER') and 'events' in file['EXT_TRIGGER']:
        records = file['EXT_TRIGGER/events'][()]
        return _edges(records['t'].astype(np.int64) * 1000, records['id'], records['p'])
    return _edges(np.empty(0), np.empty(0), np.empty(0))


def _edges(t: Any, source: Any, rising: Any) -> Triggers:
    return Triggers(
        t=t.astype(np.int64), source=source.astype(np.uint8), rising=(rising > 0).astype(np.uint8)
    )


def _size_of(file: Any) -> tuple[int, int]:
    """Columns and rows of the sensor, (0, 0) where the file does not hold them."""
    attributes = file.attrs
    found = re.match(r'(\d+)x(\d+)', str(attributes.get('geometry', '')))
    if found:
        return int(found.group(1)), int(found.group(2))
    if 'width' in attributes and 'height' in attributes:
        return int(attributes['width']), int(attributes['height'])
    if 'sensor_resolution' in attributes:
        # event_utils: rows, columns.
        height, width = (int(value) for value in attributes['sensor_resolution'][:2])
        return width, height
    return 0, 0
