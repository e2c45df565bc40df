"""Writers of events: what other libraries read by default, and what they have no place for.

| format | suffix | as |
|---|---|---|
| `text`, `evlib` | .txt | `t x y p`, t in seconds, as the datasets of RPG and evlib have it |
| `csv`, `faery` | .csv | `t,x,y,p`, t in microseconds |
| `npz` | .npz | arrays x, y, t (ns), p |
| `tonic` | .npy | records x, y, t (microseconds), p |
| `hdf5` | .h5, .hdf5 | the layout of DSEC, which evlib reads too |
| `aedat4` | .aedat4 | what DV, aedat, tonic, faery, evlib and aestream read |

Polarity is 1 or 0 in all of them. Noise labels are a column or array `noise`; what is beyond whole
microseconds is one called `ns`. AEDAT4 has a place for neither: labelled events are refused, and
times are rounded down.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.writing import WriteError, naming_file
from dvs_event_camera.files.aedat4_writer import Aedat4Writer
from dvs_event_camera.files.hdf5_writer import Hdf5Writer
from dvs_event_camera.files.numpy_writer import NpzWriter, TonicWriter
from dvs_event_camera.files.text_writer import csv_writer, text_writer
from dvs_event_camera.files.writer_form import EventWriter, WriterForm
from dvs_event_camera.streams.sensor_events import SensorEvents

_Make = Callable[[Path, WriterForm], EventWriter]
_WRITERS: dict[str, _Make] = {
    'text': text_writer,
    'csv': csv_writer,
    'npz': NpzWriter,
    'tonic': TonicWriter,
    'hdf5': Hdf5Writer,
    'aedat4': Aedat4Writer,
    'evlib': text_writer,
    'faery': csv_writer,
}
FORMATS = tuple(_WRITERS)
_SUFFIXES = {
    '.txt': 'text',
    '.csv': 'csv',
    '.npz': 'npz',
    '.npy': 'tonic',
    '.h5': 'hdf5',
    '.hdf5': 'hdf5',
    '.aedat4': 'aedat4',
}


def format_of(path: Path, chosen: str | None) -> str:
    """Format to write a file in.

    Parameters
    ----------
    path
        The file.
    chosen
        One of `FORMATS`; None for the one of the suffix.

    Raises
    ------
    ParameterError
        If the suffix is none of those that are known.
    """
    if chosen is not None:
        return chosen
    found = _SUFFIXES.get(path.suffix.lower())
    if found is None:
        raise ParameterError('output', path, f'must end in one of {", ".join(_SUFFIXES)}')
    return found


class LazyWriter:
    """A writer that begins with the first stretch, when it is known whether there are labels.

    Parameters
    ----------
    path
        File to write.
    name
        One of `FORMATS`.
    width
        Columns of the sensor, 0 where that is not known.
    height
        Rows of the sensor, 0 where that is not known.
    whole_microseconds
        Whether all times are whole microseconds.
    """

    def __init__(
        self, path: Path, name: str, *, width: int, height: int, whole_microseconds: bool
    ) -> None:
        self._path = path
        self._make = _WRITERS[name]
        self._rows_of_text = self._make in (text_writer, csv_writer)
        self._size = (width, height)
        self._whole_microseconds = whole_microseconds
        self._labelled = False
        self._writer: EventWriter | None = None

    def add(self, events: SensorEvents) -> None:
        """Write a stretch; see `EventWriter.add`.

        Raises
        ------
        ParameterError
            If the format has no place for what the events carry.
        WriteError
            If the disk is full; rows of text that were written before stay.
        """
        labelled = events.noise is not None
        if self._writer is not None and labelled and not self._labelled:
            raise ParameterError(
                'output', self._path, 'was begun without labels, and now a packet has some'
            )
        with self._nothing_useless_left():
            self._writer = self._writer or self._begin(labelled)
            self._writer.add(events if labelled or not self._labelled else events.with_labels())

    def _begin(self, labelled: bool) -> EventWriter:
        self._labelled = labelled
        width, height = self._size
        form = WriterForm(
            width=width,
            height=height,
            whole_microseconds=self._whole_microseconds,
            labelled=labelled,
        )
        return self._make(self._path, form)

    def close(self) -> None:
        """Write what is left, an empty file if there was no event; see `EventWriter.close`.

        Raises
        ------
        WriteError
            If the disk is full.
        """
        with self._nothing_useless_left():
            self._writer = self._writer or self._begin(labelled=False)
            self._writer.close()

    @contextmanager
    def _nothing_useless_left(self) -> Iterator[None]:
        """Name the file that can't be written; of a broken one keep only rows of text."""
        try:
            with naming_file(self._path):
                yield
        except WriteError:
            with suppress(OSError):
                if not self._rows_of_text or self._path.stat().st_size == 0:
                    self._path.unlink()
            raise
