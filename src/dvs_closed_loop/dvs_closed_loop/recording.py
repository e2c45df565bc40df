"""A rosbag2 written without rosbag2: raw CDR messages to MCAP by the PyPI package rosbags."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


class BagWriter:
    """Writes serialized messages; a context manager that leaves a readable bag behind.

    Parameters
    ----------
    path
        Folder of the bag; must not exist.
    topics
        Message type, as package/msg/Type, of every topic.
    """

    def __init__(self, path: Path, topics: dict[str, str]) -> None:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._connections = {
            topic: self._writer.add_connection(topic, message_type, typestore=typestore)
            for topic, message_type in topics.items()
        }

    def write(self, topic: str, received_ns: int, message: bytes) -> None:
        """Append one message.

        Parameters
        ----------
        topic
            One of the topics given at the start.
        received_ns
            Time of reception, ns.
        message
            CDR bytes.
        """
        self._writer.write(self._connections[topic], received_ns, message)

    def __enter__(self) -> BagWriter:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag, whatever happened."""
        self._writer.close()
