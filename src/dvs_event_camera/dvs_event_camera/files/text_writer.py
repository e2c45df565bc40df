"""Writers of text and CSV files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS
from dvs_event_camera.files.trigger_file import TriggerWriter
from dvs_event_camera.files.writer_form import WriterForm
from dvs_event_camera.streams.compiled import compiled
from dvs_event_camera.streams.sensor_events import SensorEvents

# Events whose rows are put together at a time.
_PIECE = 2**16


def text_writer(path: Path, form: WriterForm) -> RowWriter:
    """Writer of `t x y p` with t in seconds.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.
    """
    return RowWriter(path, head='# ', separator=' ', in_seconds=True, form=form)


def csv_writer(path: Path, form: WriterForm) -> RowWriter:
    """Writer of `t,x,y,p` with t in microseconds.

    Parameters
    ----------
    path
        File to write.
    form
        What the events are like.
    """
    return RowWriter(path, head='', separator=',', in_seconds=False, form=form)


class RowWriter:
    """Writes a row of whole numbers an event.

    Parameters
    ----------
    path
        File to write.
    head
        First line.
    separator
        Between two columns.
    in_seconds
        Whether the time is seconds with nine decimals; else microseconds.
    form
        What the events are like.
    """

    def __init__(
        self, path: Path, *, head: str, separator: str, in_seconds: bool, form: WriterForm
    ) -> None:
        self._extra = form.extra_columns(exact_time=in_seconds)
        self._in_seconds = in_seconds
        self._triggers = TriggerWriter(path)
        columns = 4 + in_seconds + len(self._extra)
        self._digits = np.ones(columns, np.int64)
        self._ends = np.full(columns, ord(separator), np.uint8)
        self._ends[-1] = ord('\n')
        if in_seconds:
            self._digits[1], self._ends[0] = 9, ord('.')
        self._kernels = compiled('dvs_event_camera.files.rows_numba')
        self._file = path.open('wb')
        names = separator.join((*'txyp', *self._extra))
        self._file.write(f'{head}{names}\n'.encode())

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`."""
        for start in range(0, len(events), _PIECE):
            self._file.write(self._formatted(events.take(slice(start, start + _PIECE))))
        self._triggers.add(events.triggers)

    def _formatted(self, events: SensorEvents) -> memoryview:
        if self._in_seconds and events.t.min() < 0:
            raise ParameterError('time', int(events.t.min()), 'must be >= 0 in a text file')
        whole, rest = np.divmod(events.t, NANOSECONDS if self._in_seconds else 1000)
        extra = {'noise': events.with_labels().noise, 'ns': rest}
        columns = [whole, *([rest] if self._in_seconds else []), events.x, events.y, events.p]
        columns += [np.asarray(extra[name]) for name in self._extra]
        values = np.column_stack([column.astype(np.int64) for column in columns])
        return self._text(values)

    def _text(self, values: NDArray[np.int64]) -> memoryview:
        out = np.empty(values.size * (self._kernels.LONGEST + 1), np.uint8)
        size = self._kernels.format_rows(values, self._digits, self._ends, out)
        return out[:size].data

    def close(self) -> None:
        """Close the file; see `EventWriter.close`."""
        self._file.close()
