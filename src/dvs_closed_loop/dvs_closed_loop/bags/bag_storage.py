"""Storages of a bag that write in batches, each of them whole or not at all.

Those of `rosbags` leave an unreadable file behind when the disk is full: the MCAP writer ends in
the middle of a record and never writes its footer; SQLite rolls the whole recording back, since it
is one transaction. Here a failed batch is undone on disk and kept in memory, so that it can be
written again once there is room, or given up.
"""

from __future__ import annotations

import io
import sqlite3
from collections import Counter
from contextlib import suppress
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

_BATCH_BYTES = 2**18
_SUMMARY_BYTES = 2**16
_SUMMARY_BYTES_PER_BATCH = 512


class SolidFile:
    """Unbuffered file that writes everything or raises, and can take back what it wrote last.

    Parameters
    ----------
    path
        Existing file; writing goes on at its end.
    """

    def __init__(self, path: Path) -> None:
        self._file = io.FileIO(path, 'r+b')
        self._file.seek(0, io.SEEK_END)

    def write(self, data: bytes | bytearray | memoryview) -> int:
        """Append `data`; return its size.

        Parameters
        ----------
        data
            Bytes.

        Raises
        ------
        OSError
            If the disk is full or the file may not grow; part of `data` may be written then.
        """
        view = memoryview(data).cast('B')
        done = 0
        while done < len(view):
            done += self._file.write(view[done:]) or 0
        return done

    def tell(self) -> int:
        """Return the size so far."""
        return self._file.tell()

    def rewind(self, position: int) -> None:
        """Forget everything after `position`.

        Parameters
        ----------
        position
            An earlier `tell`.
        """
        self._file.truncate(position)
        self._file.seek(position)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class BatchedMcap(McapWriter):
    """MCAP file of small chunks.

    Parameters
    ----------
    path
        Folder of the bag.
    compression
        Compression of the chunks.
    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self._file = SolidFile(self.path)
        self.bio = self._file  # type: ignore[assignment]
        self._batches: list[tuple[int, Counter[int]]] = []

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Append one message; see `rosbags.rosbag2.storage_mcap.McapWriter`.

        Parameters
        ----------
        connection
            Connection of its topic.
        timestamp
            Time of reception, ns.
        data
            CDR bytes.
        """
        super().write(connection, timestamp, data)
        if self.chunk.bio.tell() > _BATCH_BYTES:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the pending batch; if that fails, nothing of it is left in the file."""
        start = self._file.tell()
        counts = Counter({cid: len(messages) for cid, messages in self.chunk.msgs.items()})
        try:
            super().close_chunk()
        except OSError:
            self._file.rewind(start)
            raise
        self._batches.append((start, counts))

    def flush(self) -> None:
        """Write the pending batch and make sure that the file can be finished.

        Raises
        ------
        OSError
            If there is no room.
        """
        if self.chunk.bio.tell():
            self.close_chunk()
        end = self._file.tell()
        try:
            self._file.write(bytes(_SUMMARY_BYTES + _SUMMARY_BYTES_PER_BATCH * len(self._batches)))
        finally:
            self._file.rewind(end)

    def give_up_batch(self) -> Counter[int]:
        """Drop the pending batch, or else the last one written; return its messages by connection.

        The first batch stays if it is written: it holds the definitions.
        """
        if self.chunk.msgs:
            counts = Counter({cid: len(messages) for cid, messages in self.chunk.msgs.items()})
            self._clear_chunk()
        elif len(self._batches) > 1:
            start, counts = self._batches.pop()
            self.chunks.pop()
            self._file.rewind(start)
        else:
            return Counter()
        for connection, count in counts.items():
            self.channel_stats[connection] -= count
        return counts

    def _clear_chunk(self) -> None:
        """Replace the pending chunk by one with the definitions only, where it held them."""
        # The definitions come before any message; a chunk is an attribute of the base class.
        messages = self.chunk.msgs
        first = min(offset for entries in messages.values() for _, offset in entries)
        definitions = self.chunk.bio.getvalue()[:first]
        messages.clear()
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()
        self.chunk.bio.write(definitions)


class BatchedSqlite(Sqlite3Writer):
    """SQLite file with one transaction a batch.

    Parameters
    ----------
    path
        Folder of the bag.
    compression
        Must be none.
    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        # A killed recorder must not corrupt the file; a power cut may.
        self.conn.execute('PRAGMA synchronous = OFF')
        self._pending: list[tuple[int, int, bytes | memoryview]] = []
        self._pending_bytes = 0

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Append one message; see `rosbags.rosbag2.storage_sqlite3.Sqlite3Writer`.

        Parameters
        ----------
        connection
            Connection of its topic.
        timestamp
            Time of reception, ns.
        data
            CDR bytes.
        """
        self._pending.append((connection.id, timestamp, data))
        self._pending_bytes += len(data) + 64
        if self._pending_bytes > _BATCH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Commit the pending batch.

        Raises
        ------
        OSError
            If there is no room; nothing of the batch is left in the file then.
        """
        try:
            self.cursor.executemany(
                'INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)', self._pending
            )
            self.conn.commit()
        except sqlite3.OperationalError as error:
            with suppress(sqlite3.Error):
                self.conn.rollback()
            raise OSError(str(error)) from None
        self._pending.clear()
        self._pending_bytes = 0

    def give_up_batch(self) -> Counter[int]:
        """Drop the pending batch; return its messages by connection."""
        counts = Counter(connection for connection, _, _ in self._pending)
        self._pending.clear()
        self._pending_bytes = 0
        return counts

    def close(self, version: int, metadata: str) -> None:
        """Finish the file; its copy of the metadata is left out where it does not fit.

        Parameters
        ----------
        version
            Version of the metadata.
        metadata
            Text of the metadata.
        """
        try:
            super().close(version, metadata)
        except sqlite3.OperationalError:
            self.abort()
