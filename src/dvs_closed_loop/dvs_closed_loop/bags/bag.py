"""A recorded run, ours or by `ros2 bag`, read into memory; needs no ROS."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError

from dvs_closed_loop.bags.recording import NAME_KEY, PARAMETERS_KEY
from dvs_closed_loop.bags.streams import STREAMS, base_name
from dvs_common.errors import ParameterError
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
        return (self.messages[-1].received_ns - self.messages[0].received_ns) * 1e-9


def read_bag(
    path: Path, *, namespace: str | None = None, topics: list[str] | None = None
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

    Raises
    ------
    ParameterError
        If the bag can't be read, holds no topic of the contract, or holds several loops and none
        was chosen.
    """
    with _opened(path) as reader:
        chosen = _choose_loop(path, reader.connections, namespace)
        names = {topic: connection.topic for topic, connection in chosen.items()}
        of_id = {
            connection.topic: topic
            for topic, connection in chosen.items()
            if topics is None or topic in topics
        }
        wanted = [c for c in reader.connections if c.topic in of_id]
        messages = tuple(
            RecordedMessage(topic=of_id[connection.topic], received_ns=time_ns, data=bytes(data))
            for connection, time_ns, data in (reader.messages(wanted) if wanted else ())
        )
        custom = reader.storage.metadata.custom or {}
        ignored = {c.topic for c in reader.connections} - set(names.values())
        scenario = custom.get(PARAMETERS_KEY)
        return RecordedBag(
            path=path,
            messages=tuple(sorted(messages, key=lambda message: message.received_ns)),
            names=names,
            ignored=tuple(sorted(ignored)),
            scenario=None if scenario is None else Scenario.from_values(json.loads(scenario)),
            scenario_name=custom.get(NAME_KEY, path.stem),
            writer=reader.ros_distro or 'unknown',
        )


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


def _choose_loop(
    path: Path, connections: list[Connection], namespace: str | None
) -> dict[str, Connection]:
    """Connection of every topic of the contract, all of one namespace."""
    found: dict[str, dict[str, Connection]] = {}
    absolute: dict[str, Connection] = {}
    for connection in connections:
        if connection.topic in STREAMS and connection.topic.startswith('/'):
            absolute[connection.topic] = connection
            continue
        base = base_name(connection.topic)
        # A loop in a namespace has a clock of its own.
        stream = STREAMS.get(base) or STREAMS.get('/' + base)
        if stream is None or stream.type_name != connection.msgtype:
            continue
        own = '/' + connection.topic.rpartition('/')[0].strip('/')
        found.setdefault(own, {})[stream.topic] = connection
    if not found and namespace is None and absolute:
        return absolute
    if not found:
        raise ParameterError('bag', path, 'holds no topic of the wire contract')
    if namespace is None and len(found) > 1:
        raise ParameterError('namespace', '', f'must be one of {", ".join(sorted(found))}')
    key = next(iter(found)) if namespace is None else '/' + namespace.strip('/')
    if key not in found:
        raise ParameterError('namespace', namespace, f'must be one of {", ".join(sorted(found))}')
    return {**absolute, **found[key]}
