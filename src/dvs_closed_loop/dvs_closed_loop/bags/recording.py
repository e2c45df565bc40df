"""A rosbag2 written without rosbag2: raw CDR messages to MCAP or SQLite by the package rosbags.

A full disk ends a recording with an error and a readable bag: see `bag_storage`, and the reserve
that a `BagWriter` holds on the disk for the end of the bag.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from dvs_closed_loop.bags.bag_storage import BatchedMcap, BatchedSqlite
from dvs_closed_loop.bags.streams import STREAMS, base_name
from dvs_common.errors import ParameterError, SuiteError
from dvs_common.scenario.scenario import Scenario

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

STORAGES = ('mcap', 'sqlite3')
# Keys of the bag's custom data.
NAME_KEY = 'dvs_scenario'
PARAMETERS_KEY = 'dvs_parameters'
_RESERVE_BYTES = 2**21


class BagFullError(SuiteError):
    """A bag that can't grow any more; what was recorded before is kept."""


class _Writer(Writer):
    STORAGE_PLUGINS = {  # noqa: RUF012
        StoragePlugin.SQLITE3: BatchedSqlite,
        StoragePlugin.MCAP: BatchedMcap,
    }


class BagWriter:
    """Writes serialized messages; a context manager that leaves a readable bag behind.

    Parameters
    ----------
    path
        Folder of the bag; must not exist.
    topics
        Message type, as package/msg/Type, of every topic; a name without a slash at its beginning
        gets one, since bags hold full names.
    storage
        ``mcap`` or ``sqlite3``.

    Raises
    ------
    ParameterError
        If `path` exists or can't be made, or the disk is full already.
    """

    def __init__(self, path: Path, topics: Mapping[str, str], *, storage: str = 'mcap') -> None:
        plugin = StoragePlugin.MCAP if storage == 'mcap' else StoragePlugin.SQLITE3
        self.path = path
        self._reserve = path / '.reserve'
        self._closed = False
        typestore = get_typestore(Stores.ROS2_JAZZY)
        try:
            self._writer = _Writer(path, version=9, storage_plugin=plugin)
            self._writer.open()
            _allocate(self._reserve)
        except WriterError:
            raise ParameterError('bag', path, 'exists already and is not overwritten') from None
        except OSError as error:
            raise ParameterError('bag', path, f"can't be written: {error.strerror}") from None
        self._connections = {
            topic: self._writer.add_connection(
                '/' + topic.lstrip('/'),
                message_type,
                typestore=typestore,
                offered_qos_profiles=_offered_qos(topic),
            )
            for topic, message_type in topics.items()
        }

    @property
    def size_bytes(self) -> int:
        """Bytes on the disk, without the reserve."""
        files = (file for file in self.path.iterdir() if file != self._reserve)
        return sum(file.stat().st_size for file in files)

    def keep_scenario(self, scenario: Scenario, name: str) -> None:
        """Store the parameters of the run in the bag, for `report`.

        Parameters
        ----------
        scenario
            Parameters of the run.
        name
            Name of the scenario.
        """
        self._writer.set_custom_data(NAME_KEY, name)
        self._writer.set_custom_data(PARAMETERS_KEY, json.dumps(dict(scenario.values)))

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

        Raises
        ------
        BagFullError
            If it can't be written; the bag is closed and readable then.
        """
        if self._closed:
            return
        connection = self._connections[topic]
        try:
            self._writer.write(connection, received_ns, message)
        except OSError as error:
            # The message is in the pending batch, but rosbags has not counted it.
            self._writer.counts[connection.id] += 1
            self._writer.max_timestamp = max(self._writer.max_timestamp, received_ns)
            self.close()
            raise BagFullError(
                f"the recording ends: {self.path} can't grow ({error.strerror or error}); "
                'what was recorded before is kept'
            ) from None

    def close(self) -> None:
        """Finish the bag; messages that do not fit any more are given up."""
        if self._closed:
            return
        self._closed = True
        self._reserve.unlink(missing_ok=True)
        storage = self._writer.storage
        assert isinstance(storage, BatchedMcap | BatchedSqlite)
        while True:
            try:
                storage.flush()
                break
            except OSError:
                counts = storage.give_up_batch()
                if not counts:
                    break
                for connection, count in counts.items():
                    self._writer.counts[connection] -= count
        self._writer.close()

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
        self.close()


def _allocate(path: Path) -> None:
    """Keep room on the disk for the end of the bag."""
    with path.open('wb') as file:
        try:
            os.posix_fallocate(file.fileno(), 0, _RESERVE_BYTES)
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise
            # A limit on the size of files, or a file system without allocation: no reserve.
            with suppress(OSError):
                file.truncate(0)


def _offered_qos(topic: str) -> list[Qos]:
    stream = STREAMS.get(topic) or STREAMS.get(base_name(topic))
    return [_recorded_qos(stream.offered_qos)] if stream else []


def _recorded_qos(qos: QoSProfile) -> Qos:
    infinite = QosTime(9223372036, 854775807)
    latched = qos.durability.name == 'TRANSIENT_LOCAL'
    reliable = qos.reliability.name == 'RELIABLE'
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=infinite,
        lifespan=infinite,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=infinite,
        avoid_ros_namespace_conventions=False,
    )
