"""What the files of a bag have in common: batches, each whole or not there, and their tally.

A batch is written when it is large enough or a second old, so that a recorder that is killed
leaves all but the last second. One that finds no room is undone on the disk and kept in memory: it
is written again once there is room, or given up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from dvs_closed_loop.bags.bag_metadata import BagContent

BATCH_BYTES = 2**18
# A message without its data.
MESSAGE_BYTES = 64


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

        Raises
        ------
        OSError
            If there is no room for the batch, or none for this message.
        """

    def flush(self) -> None:
        """Write the batch; OSError if there is no room, and then nothing of it is in the file."""

    def note(self, metadata: str) -> None:
        """Write the metadata as they are now, at once; OSError if there is no room.

        Parameters
        ----------
        metadata
            Text of the bag's metadata.
        """

    def finish(self, metadata: str) -> None:
        """Write the batch and the end of the file, as far as they fit, and close it.

        Parameters
        ----------
        metadata
            Text of the bag's metadata.
        """
