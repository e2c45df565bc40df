"""The streams of the wire contract by name and type, for tools that record, play and show them."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_event_camera.streams.event_packet import MESSAGE_TYPE as EVENT_PACKET
from dvs_event_camera.tools.packet_type import event_packet_type

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """One topic of the wire contract.

    Parameters
    ----------
    topic
        Name, relative to the loop's namespace unless it begins with a slash.
    type_name
        Message type as package/msg/Type.
    latched
        Whether its last messages wait for a late subscriber, in lockstep at least.
    on_demand
        Whether it is published only while it has a subscriber, or with `label_noise`, and is made
    from other streams.
    """

    topic: str
    type_name: str
    latched: bool = False
    on_demand: bool = False

    @property
    def message_type(self) -> type:
        """Generated message class."""
        if self.type_name == EVENT_PACKET:
            return event_packet_type()
        package, _, name = self.type_name.split('/')
        found: type = getattr(import_module(f'{package}.msg'), name)
        return found

    @property
    def offered_qos(self) -> QoSProfile:
        """Quality of service that satisfies every subscriber of the contract."""
        if self.topic == topics.CLOCK:
            return topics.clock_qos()
        if self.topic == topics.KEYFRAME:
            return topics.latched_qos(depth=1)
        return topics.latched_qos() if self.latched else topics.stream_qos()


STREAMS = {
    stream.topic: stream
    for stream in (
        Stream(topic=topics.LUMINOSITY, type_name='sensor_msgs/msg/Image'),
        Stream(topic=topics.EVENTS, type_name='sensor_msgs/msg/PointCloud2', latched=True),
        Stream(topic=topics.COMMAND, type_name='sensor_msgs/msg/JointState', latched=True),
        Stream(topic=topics.STATE, type_name='sensor_msgs/msg/JointState'),
        Stream(topic=topics.ESTIMATE, type_name='sensor_msgs/msg/JointState'),
        Stream(topic=topics.KEYFRAME, type_name='sensor_msgs/msg/PointCloud2', latched=True),
        Stream(topic=topics.KEYFRAME_REQUEST, type_name='std_msgs/msg/Empty'),
        Stream(topic=topics.ANCHOR, type_name='sensor_msgs/msg/Image'),
        Stream(topic=topics.CLOCK, type_name='rosgraph_msgs/msg/Clock'),
        Stream(topic=topics.DIAGNOSTICS, type_name='diagnostic_msgs/msg/DiagnosticArray'),
        Stream(topic=topics.EVENTS_LABEL, type_name='sensor_msgs/msg/PointCloud2', on_demand=True),
        Stream(topic=topics.EVENTS_PACKET, type_name=EVENT_PACKET, on_demand=True),
        Stream(topic=topics.POLARITY, type_name='std_msgs/msg/Int16MultiArray', on_demand=True),
        Stream(topic=topics.EVENT_IMAGE, type_name='sensor_msgs/msg/Image', on_demand=True),
        Stream(topic=topics.EVENT_CLOUD, type_name='sensor_msgs/msg/PointCloud2', on_demand=True),
    )
}


def chosen_streams(names: list[str] | None) -> list[Stream]:
    """Streams called `names`; all that are not on demand for None.

    Parameters
    ----------
    names
        Topics of the wire contract.

    Raises
    ------
    ParameterError
        If a name is not in the wire contract.
    """
    if names is None:
        return [stream for stream in STREAMS.values() if not stream.on_demand]
    for name in names:
        if name not in STREAMS:
            raise ParameterError('topics', name, f'must be among {", ".join(STREAMS)}')
    return [STREAMS[name] for name in dict.fromkeys(names)]


def base_name(topic: str) -> str:
    """Last part of a topic's name.

    Parameters
    ----------
    topic
        Name with or without a namespace.
    """
    return topic.rpartition('/')[2]
