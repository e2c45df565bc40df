"""The SQLite file of a bag, written in batches."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from dvs_closed_loop.bags.bag_metadata import VERSION, BagTopic
from dvs_closed_loop.bags.bag_storage import BATCH_BYTES, MESSAGE_BYTES, Tally

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
        with self._transaction():
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

    def write(self, topic: int, received_ns: int, published_ns: int, message: bytes) -> None:
        """Append one message, without its time of publication; see `Storage.write`."""
        self._pending.append((topic, received_ns, message))
        self.tally.add(topic, received_ns, len(message) + MESSAGE_BYTES)
        if self.tally.pending_bytes > BATCH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Commit the batch; see `Storage.flush`."""
        with self._transaction():
            self._connection.executemany(
                'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)', self._pending
            )
        self._pending.clear()
        self.tally.commit()

    def note(self, metadata: str) -> None:
        """Replace the metadata; see `Storage.note`."""
        with self._transaction():
            self._connection.execute(
                'INSERT OR REPLACE INTO metadata VALUES (1, ?, ?)', (VERSION, metadata)
            )

    def finish(self, metadata: str) -> None:
        """Commit what is left and a copy of the metadata; see `Storage.finish`."""
        with suppress(OSError):
            self.flush()
        with suppress(OSError):
            self.note(metadata)
        self._connection.close()

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """All of the changes, or OSError and none of them."""
        try:
            yield
            self._connection.commit()
        except sqlite3.OperationalError as error:
            with suppress(sqlite3.Error):
                self._connection.rollback()
            raise OSError(errno.ENOSPC, str(error)) from None
