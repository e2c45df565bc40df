"""A recorded run, ours or by `ros2 bag`, read into memory; needs no ROS."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2 import Reader, ReaderError

from dvs_closed_loop.bags.loop_topics import choose_topics
from dvs_closed_loop.bags.recording import NAME_KEY, PARAMETERS_KEY
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.scenario import Scenario

# What rosbags raises on damaged files, beside its own errors.
_DAMAGE = (ReaderError, OSError, ValueError, TypeError, KeyError, EOFError, struct.error)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedMessage:
    """One message of a bag.

    Parameters
    ----------
    topic
        Topic of the wire contract.
    received_ns
        Time of reception, ns.
    data
        CDR bytes.
    """

    topic: str
    received_ns: int
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedBag:
    """Messages of one loop in a bag.

    Parameters
    ----------
    path
        The bag.
    messages
        All messages of the wire contract, in the order of their reception.
    names
        Full name of every topic of the contract in the bag.
    ignored
        Topics of the bag that are not of this loop.
    scenario
        Parameters stored in the bag, or None.
    scenario_name
        Name of the scenario.
    writer
        Distribution that wrote the bag, as far as it says.
    """

    path: Path
    messages: tuple[RecordedMessage, ...]
    names: dict[str, str]
    ignored: tuple[str, ...]
    scenario: Scenario | None
    scenario_name: str
    writer: str

    def of(self, topic: str) -> list[bytes]:
        """CDR bytes of one topic, in the order of their reception.

        Parameters
        ----------
        topic
            Topic of the wire contract.
        """
        return [message.data for message in self.messages if message.topic == topic]

    def times_ns(self, topic: str) -> list[int]:
        """Times of reception of one topic, ns.

        Parameters
        ----------
        topic
            Topic of the wire contract.
        """
        return [message.received_ns for message in self.messages if message.topic == topic]

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last, s."""
        if not self.messages:
            return 0.0
        return as_seconds(self.messages[-1].received_ns - self.messages[0].received_ns)


def read_bag(
    path: Path,
    *,
    namespace: str | None = None,
    topics: list[str] | None = None,
    given: Mapping[str, str] | None = None,
) -> RecordedBag:
    """Messages of one loop in a rosbag2 of whatever storage and writer.

    Parameters
    ----------
    path
        Folder of the bag, or a single ``.mcap`` or ``.db3`` file.
    namespace
        Namespace of the loop; None for the only one in the bag.
    topics
        Topics of the wire contract to read; None for all.
    given
        Full names of topics of the contract that are called otherwise in the bag.

    Raises
    ------
    ParameterError
        If the bag can't be read, holds no topic of the contract, or holds several loops and none
        was chosen.
    """
    with _opened(path) as reader:
        found = {connection.topic: connection.msgtype for connection in reader.connections}
        names = choose_topics(
            found,
            namespace=namespace,
            given=given or {},
            first_message=lambda topic: _first_message(reader, topic),
        )
        if not names:
            raise ParameterError('bag', path, 'holds no topic of the wire contract')
        of_name = {
            name: topic for topic, name in names.items() if topics is None or topic in topics
        }
        wanted = [c for c in reader.connections if c.topic in of_name]
        messages = tuple(
            RecordedMessage(topic=of_name[connection.topic], received_ns=time_ns, data=bytes(data))
            for connection, time_ns, data in (reader.messages(wanted) if wanted else ())
        )
        custom = reader.storage.metadata.custom or {}
        scenario = custom.get(PARAMETERS_KEY)
        return RecordedBag(
            path=path,
            messages=tuple(sorted(messages, key=lambda message: message.received_ns)),
            names=names,
            ignored=tuple(sorted(found.keys() - set(names.values()))),
            scenario=None if scenario is None else Scenario.from_values(json.loads(scenario)),
            scenario_name=custom.get(NAME_KEY, path.stem),
            writer=reader.ros_distro or 'unknown',
        )


def _first_message(reader: Reader, topic: str) -> bytes | None:
    wanted = [c for c in reader.connections if c.topic == topic]
    return next((bytes(data) for _, _, data in reader.messages(wanted)), None)


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    """Open a bag; whatever is wrong with the file becomes one message."""
    try:
        with Reader(path) as reader:
            yield reader
    except ParameterError:
        raise
    except FileNotFoundError as error:
        reason = 'does not exist'
        if path.is_dir():
            reason = 'is not a rosbag2: holds no metadata.yaml'
            if (path / 'metadata.yaml').exists():
                reason = f'is not complete: {error}'
        raise ParameterError('bag', path, reason) from None
    except _DAMAGE as error:
        raise ParameterError('bag', path, f'is not a readable rosbag2: {error}') from None
