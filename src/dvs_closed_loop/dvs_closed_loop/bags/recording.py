"""A rosbag2 written without rosbag2: raw CDR messages to MCAP or SQLite.

A full disk ends a recording with an error and a readable bag: see `bag_storage`, and the reserve
that a `BagWriter` holds on the disk for the end of the bag.
"""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from dvs_closed_loop.bags.bag_metadata import BagTopic, metadata_text
from dvs_closed_loop.bags.bag_storage import Storage
from dvs_closed_loop.bags.mcap_storage import McapStorage
from dvs_closed_loop.bags.sqlite_storage import SqliteStorage
from dvs_closed_loop.bags.streams import STREAMS, base_name
from dvs_common.errors import ParameterError, SuiteError
from dvs_common.scenario.scenario import Scenario
from dvs_common.writing import write_text

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

_KINDS: Mapping[str, type[McapStorage | SqliteStorage]] = {
    'mcap': McapStorage,
    'sqlite3': SqliteStorage,
}
STORAGES = tuple(_KINDS)
# Keys of the bag's custom data.
NAME_KEY = 'dvs_scenario'
PARAMETERS_KEY = 'dvs_parameters'
_RESERVE_BYTES = 2**21
# The longest that a message waits to be written.
_FLUSH_PERIOD_S = 1.0


class BagFullError(SuiteError):
    """A bag that can't grow any more; what was recorded before is kept."""


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
        self.path = path
        self._kind = storage
        self._reserve = path / '.reserve'
        self._closed = False
        self._custom: dict[str, str] = {}
        self._numbers = {topic: number for number, topic in enumerate(topics)}
        self._topics = [
            BagTopic.of('/' + topic.lstrip('/'), type_name, _offered_qos(topic))
            for topic, type_name in topics.items()
        ]
        try:
            path.mkdir(parents=True)
            self._storage: Storage = _KINDS[storage](path, self._topics)
            _allocate(self._reserve)
        except FileExistsError:
            raise ParameterError('bag', path, 'exists already and is not overwritten') from None
        except OSError as error:
            raise ParameterError('bag', path, f"can't be written: {error.strerror}") from None
        self._flushed_s = time.monotonic()

    @property
    def size_bytes(self) -> int:
        """Bytes on the disk, without the reserve."""
        files = (file for file in self.path.iterdir() if file != self._reserve)
        return sum(file.stat().st_size for file in files)

    def keep_scenario(self, scenario: Scenario, name: str) -> None:
        """Store the parameters of the run in the bag, for `report`, also of a killed recorder.

        Parameters
        ----------
        scenario
            Parameters of the run.
        name
            Name of the scenario.

        Raises
        ------
        BagFullError
            If it can't be written; the bag is closed and readable then.
        """
        custom = {NAME_KEY: name, PARAMETERS_KEY: json.dumps(dict(scenario.values))}
        if self._closed or custom == self._custom:
            return
        self._custom = custom
        try:
            self._storage.note(self._metadata())
        except OSError as error:
            self._give_up(error)

    def write(
        self, topic: str, received_ns: int, message: bytes, *, published_ns: int | None = None
    ) -> None:
        """Append one message.

        Parameters
        ----------
        topic
            One of the topics given at the start.
        received_ns
            Time of reception, ns.
        message
            CDR bytes.
        published_ns
            Time of publication, ns; that of reception if it is not known.

        Raises
        ------
        BagFullError
            If it can't be written; the bag is closed and readable then.
        """
        if self._closed:
            return
        published = received_ns if published_ns is None else published_ns
        try:
            self._storage.write(self._numbers[topic], received_ns, published, message)
        except OSError as error:
            self._give_up(error)
        self.keep_up()

    def keep_up(self) -> None:
        """Write what has waited for a second; to be called when no message comes.

        Raises
        ------
        BagFullError
            If it can't be written; the bag is closed and readable then.
        """
        now = time.monotonic()
        if self._closed or now - self._flushed_s < _FLUSH_PERIOD_S:
            return
        self._flushed_s = now
        try:
            self._storage.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
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
        with suppress(OSError):
            self._storage.flush()
        metadata = self._metadata()
        self._storage.finish(metadata)
        write_text(self.path / 'metadata.yaml', metadata)

    def _metadata(self) -> str:
        return metadata_text(
            storage=self._kind,
            file_name=self._storage.path.name,
            topics=self._topics,
            content=self._storage.tally.content,
            custom=self._custom,
        )

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


def _offered_qos(topic: str) -> QoSProfile | None:
    stream = STREAMS.get(topic) or STREAMS.get(base_name(topic))
    return stream.offered_qos if stream else None
