"""The MCAP file of a bag, written in batches."""

from __future__ import annotations

import errno
import io
import os
import resource
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from dvs_closed_loop.bags.bag_metadata import BagTopic
from dvs_closed_loop.bags.bag_storage import BATCH_BYTES, MESSAGE_BYTES, Tally

# The end of the file: definitions, and an index entry for every batch.
_SUMMARY_BYTES = 2**17
_SUMMARY_BYTES_PER_BATCH = 1024


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
        """Append one message, if the end of the file has room after it; see `Storage.write`."""
        size = len(message) + MESSAGE_BYTES
        self._require_room(size)
        self._writer.add_message(self._channels[topic], received_ns, bytes(message), published_ns)
        self.tally.add(topic, received_ns, size)
        if self.tally.pending_bytes > BATCH_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the batch; see `Storage.flush`."""
        self._batches += self.tally.pending > 0
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.commit()
        self.tally.commit()

    def note(self, metadata: str) -> None:
        """Write the metadata beside the batch; see `Storage.note`."""
        self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._file.commit()

    def finish(self, metadata: str) -> None:
        """Write what is left, then the index; see `Storage.finish`."""
        # Without room for its end the file has all batches but no index: it is readable in order.
        with suppress(OSError):
            self.flush()
            self.note(metadata)
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
