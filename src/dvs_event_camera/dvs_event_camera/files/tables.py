"""Events in text and CSV files.

| columns | time | who writes it so |
|---|---|---|
| `x y t p` | ns | this suite's table, `show_events` |
| `t x y p` | seconds with a decimal point, else microseconds | the datasets of RPG, evlib, faery |

A head with the names of the columns decides; without one the column with the times is the larger
of the first and the third. A column `noise` holds labels, a column `ns` what is beyond whole
microseconds. Polarity is ON where it is above zero. Triggers are in `NAME.triggers.csv` beside.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.recording import Recording, Stretch, are_pixel_numbers, stretch_of
from dvs_event_camera.files.trigger_file import read_triggers
from dvs_event_camera.streams.sensor_events import SensorEvents, no_events

_SYNONYMS = {'on': 'p', 'pol': 'p', 'polarity': 'p', 'timestamp': 't', 'time': 't'}
_OURS = ('x', 'y', 't', 'p')
_THEIRS = ('t', 'x', 'y', 'p')
_EXTRA = ('noise', 'ns')
_PIECE_BYTES = 2**22
# A long double holds nanoseconds since the epoch in seconds; a double does not.
_NUMBER = np.longdouble


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """How a text file is laid out.

    Parameters
    ----------
    columns
        Names of the columns.
    to_ns
        Factor from a time in the file to nanoseconds.
    data_at
        Byte at which the events begin.
    """

    columns: tuple[str, ...]
    to_ns: int
    data_at: int


def text_recording(path: Path) -> Recording:
    """Recording of a text or CSV file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ParameterError
        If its first line is no row of numbers and names no columns x, y, t, p.
    """
    with path.open('rb') as file:
        table = _table_of(path, file)
    return Recording(
        path=path,
        encoding='text',
        width=0,
        height=0,
        whole_microseconds=table.to_ns == 1000 and 'ns' not in table.columns,
        read=lambda: _stretches(path, table),
    )


def _table_of(path: Path, file: IO[bytes]) -> _Table:
    names: tuple[str, ...] = ()
    while True:
        at = file.tell()
        line = file.readline(4096)
        fields = line.decode('utf-8', 'replace').replace(',', ' ').strip().lstrip('#').split()
        if fields and not line.startswith(b'#') and _is_numeric(fields):
            break
        named = tuple(_SYNONYMS.get(field.lower(), field.lower()) for field in fields)
        if set(_OURS) <= set(named):
            names = named
        elif not line or (fields and not line.startswith(b'#')):
            rule = f'begins with {line[:60]!r}, neither numbers nor the names x, y, t, p'
            raise ParameterError('file', path, rule if line else 'holds no event')
    names = names or _guessed(fields)
    if len(fields) != len(names):
        rule = f'has {len(fields)} columns in its first row, not {" ".join(names)}'
        raise ParameterError('file', path, rule)
    in_seconds = '.' in fields[names.index('t')] or 'e' in fields[names.index('t')]
    units = NANOSECONDS if in_seconds else 1 if names[:4] == _OURS else 1000
    return _Table(columns=names, to_ns=units, data_at=at)


def _is_numeric(fields: list[str]) -> bool:
    try:
        [float(field) for field in fields]
    except ValueError:
        return False
    return True


def _guessed(fields: list[str]) -> tuple[str, ...]:
    first_is_time = '.' in fields[0] or (len(fields) > 2 and float(fields[0]) > float(fields[2]))
    return (*(_THEIRS if first_is_time else _OURS), *_EXTRA[: max(len(fields) - 4, 0)])


def _stretches(path: Path, table: _Table) -> Iterator[Stretch]:
    triggers = read_triggers(path)
    if len(triggers):
        yield stretch_of(no_events(triggers))
    row = 0
    with path.open('rb') as file:
        file.seek(table.data_at)
        while lines := file.readlines(_PIECE_BYTES):
            rows = _rows(b''.join(lines), len(table.columns))
            if rows is None:
                rows = _rows_until_broken(lines, len(table.columns))
            rows = rows[: _possible(rows, table)]
            whole = len(rows) == len(lines)
            yield stretch_of(_events(rows, table))
            row += len(rows)
            if not whole:
                raise DamagedFile(path, f'has no event in row {row + 1} of its data')


def _rows(text: bytes, columns: int) -> NDArray[np.longdouble] | None:
    """Numbers of some lines, shape (rows, columns); None if they are not all rows of numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter('error', DeprecationWarning)
        try:
            numbers = np.fromstring(text.replace(b',', b' '), _NUMBER, sep=' ')
        except (DeprecationWarning, ValueError):
            return None
    lines = len(text.splitlines())
    return numbers.reshape(-1, columns) if numbers.size == lines * columns else None


def _rows_until_broken(lines: list[bytes], columns: int) -> NDArray[np.longdouble]:
    good = []
    for line in lines:
        row = _rows(line, columns)
        if row is None:
            break
        good.append(row)
    return np.concatenate(good) if good else np.empty((0, columns), _NUMBER)


def _possible(rows: NDArray[np.longdouble], table: _Table) -> int:
    """How many rows there are before the first that can be no event."""
    column = {name: rows[:, k] for k, name in enumerate(table.columns)}
    good = are_pixel_numbers(column['x']) & are_pixel_numbers(column['y'])
    good &= (np.abs(column['t'] * table.to_ns) < 2.0**63) & np.isfinite(column['p'])
    return len(rows) if good.all() else int(np.argmin(good))


def _events(rows: NDArray[np.longdouble], table: _Table) -> SensorEvents:
    column = {name: rows[:, k] for k, name in enumerate(table.columns)}
    t = np.rint(column['t'] * table.to_ns).astype(np.int64)
    if 'ns' in column:
        t += column['ns'].astype(np.int64)
    return SensorEvents(
        t=t,
        x=column['x'].astype(np.uint16),
        y=column['y'].astype(np.uint16),
        p=(column['p'] > 0).astype(np.uint8),
        noise=column['noise'].astype(np.uint8) if 'noise' in column else None,
    )
