"""Node `packet_bridge`: a real driver's EventPacket messages as `events`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from dvs_common.errors import ParameterError
from dvs_common.node.session import ros_session
from dvs_common.node.spin import answer_of
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import pack_events
from dvs_event_camera.streams.packet_bridge import PacketBridge
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_event_camera.tools.packet_type import event_packet_type

_DEPTH = 1000
_HELP = """usage: {program} [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] ...]

A ROS 2 node: EventPacket messages of a driver on events_packet become events. Parameters are
region, binning and masked_pixels; docs/hardware.md explains them."""


class PacketBridgeNode(Node):
    """Takes EventPacket on `events_packet`; publishes `events`.

    Parameters
    ----------
    message_type
        Class of the messages, from `event_packet_type`.
    """

    def __init__(self, message_type: type) -> None:
        super().__init__('packet_bridge')
        self._bridge = PacketBridge(self._pixel_map())
        self._events = self.create_publisher(PointCloud2, topics.EVENTS, topics.stream_qos())
        # Drivers publish best effort, which a reliable subscription would not receive.
        qos = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(message_type, topics.EVENTS_PACKET, self._take, qos, raw=True)

    def _pixel_map(self) -> PixelMap:
        integers = Parameter.Type.INTEGER_ARRAY
        return PixelMap(
            region=tuple(self.declare_parameter('region', integers).value or ()),
            binning=self.declare_parameter('binning', 1).value,
            masked=tuple(self.declare_parameter('masked_pixels', integers).value or ()),
        )

    def _take(self, message: bytes) -> None:
        try:
            packets = self._bridge.take(message)
        except (MessageError, ParameterError) as error:
            self.get_logger().error(f'message refused: {error}', throttle_duration_sec=5.0)
            return
        if self._bridge.notice:
            self.get_logger().warning(self._bridge.notice, throttle_duration_sec=5.0)
        for packet in packets:
            self._events.publish(pack_events(packet))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bridge until a signal.

    Parameters
    ----------
    arguments
        Command line with ROS arguments; `sys.argv` by default.
    """
    command_line = sys.argv if arguments is None else arguments
    try:
        answer = answer_of(command_line, help_text=_HELP)
        if answer is not None:
            return answer
        with ros_session(command_line) as ros:
            ros.add(PacketBridgeNode(event_packet_type()))
            while not ros.ended:
                ros.turn()
    except ParameterError as error:
        print(f'cannot start: {error}', file=sys.stderr)
        return error.exit_code
    return 0
