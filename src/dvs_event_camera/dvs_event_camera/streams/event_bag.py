"""Event packets out of a recorded bag, by the PyPI package rosbags, without ROS."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.events import EventPacket, parse_events
from dvs_event_camera.streams.event_packet import MESSAGE_TYPE, parse_event_packet

_POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'


def bag_packets(path: Path, topic: str) -> Iterator[tuple[float, EventPacket]]:
    """Event packets of a bag and when they were recorded.

    Parameters
    ----------
    path
        Folder of a rosbag2.
    topic
        Name of the topic, with or without its namespace: `events` finds `/robot/events`.

    Yields
    ------
    received_s, packet
        Time of recording, s, and the packet.

    Raises
    ------
    ParameterError
        If there is no such bag or topic, or rosbags is not installed.
    MessageError
        If a message breaks the wire contract.
    """
    try:
        rosbag2 = importlib.import_module('rosbags.rosbag2')
    except ImportError:
        raise ParameterError('bag', path, 'needs the Python package rosbags') from None
    if not path.exists():
        raise ParameterError('bag', path, 'does not exist')
    try:
        reader = rosbag2.Reader(path)
        reader.open()
    except FileNotFoundError:
        raise ParameterError('bag', path, 'is not a rosbag2: holds no metadata.yaml') from None
    except rosbag2.ReaderError as error:
        raise ParameterError('bag', path, f'is not a readable rosbag2: {error}') from None
    try:
        yield from _packets(reader, _connection(reader, topic))
    finally:
        reader.close()


def _connection(reader: Any, topic: str) -> Any:
    wanted = '/' + topic.strip('/')
    found = [
        connection
        for connection in reader.connections
        if connection.topic.endswith(wanted) and connection.msgtype in (_POINT_CLOUD, MESSAGE_TYPE)
    ]
    if not found:
        names = sorted(connection.topic for connection in reader.connections)
        raise ParameterError('topic', topic, f'has no events in this bag; it holds {names}')
    return min(found, key=lambda connection: len(connection.topic))


def _packets(reader: Any, connection: Any) -> Iterator[tuple[float, EventPacket]]:
    index = 0
    for _, recorded_ns, message in reader.messages(connections=[connection]):
        if connection.msgtype == MESSAGE_TYPE:
            packet, _ = parse_event_packet(message, first_index=index)
            index += len(packet.events)
        else:
            packet = parse_events(message)
        yield as_seconds(recorded_ns), packet
