"""The files that bags are made of, each read by the library that reads its format."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from dvs_common.errors import ParameterError
from dvs_event_camera.files.bag_notes import BagNotes, notes_within
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.mcap_scan import ScannedMessage, scan_mcap
from dvs_event_camera.files.ros1_scan import Ros1Messages, scan_ros1
from dvs_event_camera.files.sqlite_scan import scan_sqlite

_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
# What reads a file that rosbags refuses.
_SCANS = {'.mcap': scan_mcap, '.db3': scan_sqlite, '.bag': scan_ros1}
# What rosbags raises on damaged files, beside its own errors.
DAMAGE = (OSError, ValueError, TypeError, KeyError, EOFError, AssertionError, struct.error)


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """A topic of a bag.

    Parameters
    ----------
    name
        Full name.
    type_name
        Message type as package/msg/Type.
    """

    name: str
    type_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BagMessage:
    """A message of a bag.

    Parameters
    ----------
    topic
        Its topic.
    received_ns
        When it was recorded, ns.
    data
        CDR bytes.
    """

    topic: BagTopic
    received_ns: int
    data: bytes


class Storage(Protocol):
    """One file of a bag."""

    topics: frozenset[BagTopic]
    notes: BagNotes

    def messages(self, names: Collection[str] | None) -> Iterator[BagMessage]:
        """Messages in the order of their reception.

        Parameters
        ----------
        names
            Topics to read; None for all.
        """

    def close(self) -> None:
        """Close the file."""


def opened_storage(path: Path) -> Storage:
    """Open one file of a bag.

    Parameters
    ----------
    path
        A `.mcap`, `.db3` or `.bag` file.

    Raises
    ------
    ParameterError
        If nothing of it can be read.
    """
    try:
        refusals = [import_module(f'rosbags.rosbag{n}').ReaderError for n in (1, 2)]
        try:
            return (_Ros1Storage if path.suffix == '.bag' else _Ros2Storage)(path)
        except (*refusals, *DAMAGE):
            if path.suffix not in _SCANS:
                raise
            return _Scanned(path, _SCANS[path.suffix])
    except ImportError as error:
        raise ParameterError('bag', path, f'needs the Python package {error.name}') from None
    except PermissionError as error:
        raise ParameterError('bag', path, f'cannot be opened: {error.strerror}') from None
    except Exception as error:
        raise ParameterError('bag', path, f'is not a readable bag: {error}') from None


class _Ros2Storage:
    """A file of a rosbag2, by rosbags."""

    def __init__(self, path: Path) -> None:
        rosbag2 = import_module('rosbags.rosbag2')
        self._path = path
        self._reader = rosbag2.Reader(path)
        self._reader.open()
        self.topics = _topics_of(self._reader)
        self.notes = notes_within(path)

    def messages(self, names: Collection[str] | None) -> Iterator[BagMessage]:
        """Messages; see `Storage.messages`."""
        chosen = _chosen(self._reader, names)
        try:
            for connection, received_ns, data in self._reader.messages(chosen) if chosen else ():
                yield BagMessage(
                    topic=BagTopic(name=connection.topic, type_name=connection.msgtype),
                    received_ns=received_ns,
                    data=_uncompressed(data),
                )
        # A library raises whatever its decompressors raise.
        except Exception as error:
            raise DamagedFile(self._path, f'is damaged: {error}') from None

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


class _Ros1Storage:
    """A bag of ROS 1, by rosbags; its messages as ROS 2 would have them on the wire."""

    def __init__(self, path: Path) -> None:
        rosbag1 = import_module('rosbags.rosbag1')
        self._path = path
        self._reader = rosbag1.Reader(path)
        self._reader.open()
        self.notes = BagNotes(distribution='ROS 1')
        self.topics = _topics_of(self._reader)
        self._types = Ros1Messages()
        for connection in self._reader.connections:
            self._types.register(connection.msgtype, connection.msgdef.data)

    def messages(self, names: Collection[str] | None) -> Iterator[BagMessage]:
        """Messages; see `Storage.messages`."""
        chosen = _chosen(self._reader, names)
        try:
            for connection, received_ns, data in self._reader.messages(chosen) if chosen else ():
                yield BagMessage(
                    topic=BagTopic(name=connection.topic, type_name=connection.msgtype),
                    received_ns=received_ns,
                    data=self._types.cdr(data, connection.msgtype),
                )
        # A library raises whatever its decompressors raise.
        except Exception as error:
            raise DamagedFile(self._path, f'is damaged: {error}') from None

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


class _Scanned:
    """A file that rosbags refuses, read message by message."""

    def __init__(self, path: Path, scan: Callable[[Path], Iterator[ScannedMessage]]) -> None:
        self._path, self._scan = path, scan
        self.notes = (
            BagNotes(distribution='ROS 1') if path.suffix == '.bag' else notes_within(path)
        )
        found = set()
        try:
            for message in scan(path):
                found.add(BagTopic(name=message.topic, type_name=message.type_name))
        except ValueError:
            if not found:
                raise
        self.topics = frozenset(found)

    def messages(self, names: Collection[str] | None) -> Iterator[BagMessage]:
        """Messages; see `Storage.messages`."""
        try:
            for message in self._scan(self._path):
                if names is None or message.topic in names:
                    yield BagMessage(
                        topic=BagTopic(name=message.topic, type_name=message.type_name),
                        received_ns=message.received_ns,
                        data=_uncompressed(message.data),
                    )
        except ValueError as error:
            raise DamagedFile(self._path, str(error)) from None

    def close(self) -> None:
        """Nothing stays open between two messages."""


def _topics_of(reader: Any) -> frozenset[BagTopic]:
    return frozenset(BagTopic(name=c.topic, type_name=c.msgtype) for c in reader.connections)


def _chosen(reader: Any, names: Collection[str] | None) -> list[Any]:
    return [c for c in reader.connections if names is None or c.topic in names]


def _uncompressed(data: bytes) -> bytes:
    """Bytes of a message that rosbag2 may have compressed; CDR never begins like zstd."""
    if bytes(data[:4]) != _ZSTD_MAGIC:
        return bytes(data)
    zstandard = import_module('zstandard')
    try:
        found: bytes = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        raise ValueError(f'a compressed message is broken: {error}') from None
    return found
