"""Where the messages of a bag go: batches of an MCAP or SQLite file, each whole or not there.

A batch is written when it is large enough or a second old, so that a recorder that is killed
leaves all but the last second. One that finds no room is undone on the disk and kept in memory: it
is written again once there is room, or given up.
"""

from __future__ import annotations

import errno
import io
import os
import resource
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from dvs_closed_loop.bags.bag_metadata import VERSION, BagContent, BagTopic

BATCH_BYTES = 2**18
# A message without its data.
_MESSAGE_BYTES = 64
# The end of an MCAP file: definitions, and an index entry for every batch.
_SUMMARY_BYTES = 2**17
_SUMMARY_BYTES_PER_BATCH = 1024


class Tally:
    """Messages in the file, and those of the batch that is to follow.

    Parameters
    ----------
    topics
        Number of topics.
    """

    def __init__(self, topics: int) -> None:
        self.pending = self.pending_bytes = 0
        self._written = BagContent(counts=(0,) * topics, first_ns=0, last_ns=0)
        self._whole = self._written

    @property
    def content(self) -> BagContent:
        """What is in the file."""
        return self._written

    def add(self, topic: int, received_ns: int, size: int) -> None:
        """Count a message of the batch.

        Parameters
        ----------
        topic
            Number of the topic.
        received_ns
            Time of reception, ns.
        size
            Bytes.
        """
        before = self._whole
        counts = list(before.counts)
        counts[topic] += 1
        first = any(before.counts)
        self._whole = BagContent(
            counts=tuple(counts),
            first_ns=min(before.first_ns, received_ns) if first else received_ns,
            last_ns=max(before.last_ns, received_ns),
        )
        self.pending += 1
        self.pending_bytes += size

    def commit(self) -> None:
        """Count the batch as written."""
        self._written = self._whole
        self.pending = self.pending_bytes = 0


class Storage(Protocol):
    """File of a bag, named by its `path`; `tally` counts what is in it."""

    path: Path
    tally: Tally

    def write(self, topic: int, received_ns: int, published_ns: int, message: bytes) -> None:
        """Append one message to the batch; write the batch if it is large enough.

        Parameters
        ----------
        topic
            Number of the topic.
        received_ns
            Time of reception, ns.
        published_ns
            Time of publication, ns.
        message
            CDR bytes.
        """

    def flush(self) -> None:
        """Write the batch; OSError if there is no room, and then nothing of it is in the file."""

    def finish(self, metadata: str) -> None:
        """Write the batch and the end of the file, as far as they fit, and close it.

        Parameters
        ----------
        metadata
            Text of the bag's metadata.
        """


class McapStorage:
    """MCAP file with chunks compressed by zstd, and checksums.

    Parameters
    ----------
    folder
        Folder of the bag.
    topics
        All topics.
    """

    def __init__(self, folder: Path, topics: Sequence[BagTopic]) -> None:
        self.path = folder / f'{folder.name}.mcap'
        self.tally = Tally(len(topics))
        self._batches = 0
        self._file = _WholeWrites(self.path)
        self._writer = McapWriter(self._file, chunk_size=2**31, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='dvs_closed_loop')
        schemas: dict[str, int] = {}
        self._channels = []
        for topic in topics:
            if topic.type_name not in schemas:
                schemas[topic.type_name] = self._writer.register_schema(
                    topic.type_name, 'ros2msg', topic.definition.encode()
                )
            metadata = {'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash}
            self._channels.append(
                self._writer.register_channel(
                    topic.name, 'cdr', schemas[topic.type_name], metadata
                )
            )
        self._definitions = sum(len(t.definition) + len(t.qos) + 256 for t in topics)

    def write(self, topic: int, received_ns: int, published_ns: int, message: bytes) -> None:
        """Append one message to the batch; write the batch if it is large enough.

        Parameters
        ----------
        topic
            Number of the topic.
        received_ns
            Time of reception, ns.
        published_ns
            Time of publication, ns.
        message
            CDR bytes.

        Raises
        ------
        OSError
            If there is no room for the batch, or none for this message and the end of the file.
        """
        size = len(message) + _MESSAGE_BYTES
        self._require_room(size)
        self._writer.add_message(self._channels[topic], received_ns, bytes(message), published_ns)
        self.tally.add(topic, received_ns, size)
        if self.tally.pending_bytes > BATCH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the batch.

        Raises
        ------
        OSError
            If there is no room; nothing of the batch is in the file then.
        """
        self._batches += self.tally.pending > 0
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.commit()
        self.tally.commit()

    def finish(self, metadata: str) -> None:
        """Write the batch and the end of the file, as far as they fit, and close it.

        Parameters
        ----------
        metadata
            Text of the bag's metadata.
        """
        # Without room for its end the file has all batches but no index: it is readable in order.
        with suppress(OSError):
            self.flush()
            self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.commit()
        self._file.close()

    def _require_room(self, size: int) -> None:
        """Refuse a message after which the file could not be finished within its limit."""
        limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
        if limit == resource.RLIM_INFINITY:
            return
        end = _SUMMARY_BYTES + _SUMMARY_BYTES_PER_BATCH * (self._batches + 1)
        end += 2 * self._definitions
        if self._file.tell() + self.tally.pending_bytes + size + end > limit:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))


class _WholeWrites(io.BytesIO):
    """Output that reaches the file when it is committed: all of it, or nothing.

    Parameters
    ----------
    path
        File to make.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = io.FileIO(path, 'xb')
        self._committed = 0

    def tell(self) -> int:
        """Return the size of the file with what is not committed yet."""
        return self._committed + super().tell()

    def commit(self) -> None:
        """Append what was written since the last time.

        Raises
        ------
        OSError
            If there is no room; the file is as before then.
        """
        view = self.getbuffer()
        try:
            done = 0
            while done < len(view):
                done += self._file.write(view[done:]) or 0
        except OSError:
            self._file.truncate(self._committed)
            self._file.seek(self._committed)
            raise
        finally:
            view.release()
        self._committed += done
        self.seek(0)
        self.truncate()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


_SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
  id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
  id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES (4, 'jazzy');
"""


class SqliteStorage:
    """SQLite file of rosbag2 with one transaction a batch.

    Parameters
    ----------
    folder
        Folder of the bag.
    topics
        All topics.
    """

    def __init__(self, folder: Path, topics: Sequence[BagTopic]) -> None:
        self.path = folder / f'{folder.name}.db3'
        self.tally = Tally(len(topics))
        self._pending: list[tuple[int, int, bytes]] = []
        self._connection = sqlite3.connect(self.path)
        # A killed recorder must not corrupt the file; a power cut may.
        self._connection.execute('PRAGMA synchronous = OFF')
        try:
            self._connection.executescript(_SCHEMA)
            self._connection.executemany(
                'INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)',
                [
                    (k, t.name, t.type_name, 'cdr', t.qos, t.type_hash)
                    for k, t in enumerate(topics)
                ],
            )
            types = {topic.type_name: topic for topic in topics}
            self._connection.executemany(
                'INSERT INTO message_definitions (topic_type, encoding, '
                'encoded_message_definition, type_description_hash) VALUES (?, ?, ?, ?)',
                [(t.type_name, 'ros2msg', t.definition, t.type_hash) for t in types.values()],
            )
            self._connection.commit()
        except sqlite3.OperationalError as error:
            raise OSError(errno.ENOSPC, str(error)) from None

    def write(self, topic: int, received_ns: int, published_ns: int, message: bytes) -> None:
        """Append one message to the batch; write the batch if it is large enough.

        Parameters
        ----------
        topic
            Number of the topic.
        received_ns
            Time of reception, ns.
        published_ns
            Time of publication, ns; this format has no place for it.
        message
            CDR bytes.

        Raises
        ------
        OSError
            If there is no room for the batch.
        """
        self._pending.append((topic, received_ns, message))
        self.tally.add(topic, received_ns, len(message) + _MESSAGE_BYTES)
        if self.tally.pending_bytes > BATCH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Commit the batch.

        Raises
        ------
        OSError
            If there is no room; nothing of the batch is in the file then.
        """
        try:
            self._connection.executemany(
                'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)', self._pending
            )
            self._connection.commit()
        except sqlite3.OperationalError as error:
            with suppress(sqlite3.Error):
                self._connection.rollback()
            raise OSError(errno.ENOSPC, str(error)) from None
        self._pending.clear()
        self.tally.commit()

    def finish(self, metadata: str) -> None:
        """Commit the batch and a copy of the metadata, as far as they fit, and close the file.

        Parameters
        ----------
        metadata
            Text of the bag's metadata.
        """
        with suppress(OSError):
            self.flush()
        with suppress(sqlite3.OperationalError):
            self._connection.execute(
                'INSERT INTO metadata (metadata_version, metadata) VALUES (?, ?)',
                (VERSION, metadata),
            )
            self._connection.commit()
        self._connection.close()
