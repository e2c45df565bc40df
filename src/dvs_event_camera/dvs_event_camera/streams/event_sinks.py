"""Where `show_events` puts events: a table, a CSV file, a NumPy archive."""

from __future__ import annotations

from pathlib import Path
from typing import IO, Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.events import EventPacket


class EventSink(Protocol):
    """Takes packets one after the other."""

    def add(self, packet: EventPacket) -> None:
        """Take a packet.

        Parameters
        ----------
        packet
            The packet.
        """

    def close(self) -> None:
        """Write what is left."""


def absolute_times(packet: EventPacket) -> NDArray[np.int64]:
    """Times of a packet's events, ns, shape (E,).

    Parameters
    ----------
    packet
        The packet.
    """
    return packet.stamp_ns + packet.events['t'].astype(np.int64)


class TextSink:
    """Lines ``x y t p`` with t in nanoseconds, absolute.

    Parameters
    ----------
    stream
        Where to write.
    separator
        Between columns: blanks that align them, or a comma.
    """

    def __init__(self, stream: IO[str], separator: str = ' ') -> None:
        self._stream = stream
        self._format = '{:5d} {:5d} {:19d} {:+2d}\n' if separator == ' ' else '{},{},{},{}\n'
        head = '{:>5} {:>5} {:>19} {:>2}\n' if separator == ' ' else '{},{},{},{}\n'
        stream.write(head.format('x', 'y', 't', 'p'))

    def add(self, packet: EventPacket) -> None:
        """Write a packet; see `EventSink.add`."""
        events = packet.events
        rows = zip(
            events['x'].tolist(),
            events['y'].tolist(),
            absolute_times(packet).tolist(),
            events['polarity'].tolist(),
            strict=True,
        )
        line = self._format.format
        self._stream.write(''.join(line(*row) for row in rows))

    def close(self) -> None:
        """Flush; see `EventSink.close`."""
        self._stream.flush()


class CsvSink(TextSink):
    """A CSV file with the columns x, y, t, p.

    Parameters
    ----------
    path
        File to write.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('w', encoding='ascii')
        super().__init__(self._file, ',')

    def close(self) -> None:
        """Close the file; see `EventSink.close`."""
        self._file.close()


class NpzSink:
    """A NumPy archive with the arrays x, y (uint16), t (int64, ns), p (int8).

    Parameters
    ----------
    path
        File to write.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._columns: list[list[NDArray[np.generic]]] = [[], [], [], []]

    def add(self, packet: EventPacket) -> None:
        """Keep a packet; see `EventSink.add`."""
        events = packet.events
        columns = (events['x'], events['y'], absolute_times(packet), events['polarity'])
        for column, values in zip(self._columns, columns, strict=True):
            column.append(np.array(values))

    def close(self) -> None:
        """Write the archive; see `EventSink.close`."""
        dtypes = (np.uint16, np.uint16, np.int64, np.int8)
        x, y, t, p = (
            np.concatenate(column) if column else np.empty(0, dtype)
            for column, dtype in zip(self._columns, dtypes, strict=True)
        )
        with self._path.open('wb') as stream:
            np.savez_compressed(stream, x=x, y=y, t=t, p=p)
