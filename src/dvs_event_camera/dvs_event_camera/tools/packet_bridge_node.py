"""Node `packet_bridge`: a real driver's EventPacket messages as `events`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import INDEX_MODULUS, pack_events
from dvs_event_camera.streams.event_packet import parse_event_packet
from dvs_event_camera.tools.plain_node import run_plain_node

_NOT_INSTALLED = 2
_DEPTH = 1000


class PacketBridgeNode(Node):
    """Takes EventPacket (`mono`) on `events_packet`; publishes `events`.

    A driver does not know the sums of polarities that came before: a gap in its sequence numbers
    becomes a gap in the running index, so that consumers see the loss.

    Parameters
    ----------
    message_type
        Class of the messages, `event_camera_msgs.msg.EventPacket`.
    """

    def __init__(self, message_type: type) -> None:
        super().__init__('packet_bridge')
        self._index = 0
        self._next_sequence: int | None = None
        self._events = self.create_publisher(PointCloud2, topics.EVENTS, topics.stream_qos())
        # Drivers publish best effort, which a reliable subscription would not hear.
        qos = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(message_type, topics.EVENTS_PACKET, self._take, qos, raw=True)

    def _take(self, message: bytes) -> None:
        try:
            packet, sequence = parse_event_packet(message, first_index=self._index)
        except MessageError as error:
            self.get_logger().error(f'message refused: {error}', throttle_duration_sec=5.0)
            return
        if self._next_sequence is not None and sequence != self._next_sequence:
            missing = sequence - self._next_sequence
            self.get_logger().warning(
                f'{missing} packets lost before number {sequence}'
                if missing > 0
                else f'packet numbers go back to {sequence}: the driver started again',
                throttle_duration_sec=5.0,
            )
            self._index = (self._index + 1) % INDEX_MODULUS
            packet, _ = parse_event_packet(message, first_index=self._index)
        self._next_sequence = sequence + 1
        self._index = (self._index + len(packet.events)) % INDEX_MODULUS
        self._events.publish(pack_events(packet))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bridge until a signal.

    Parameters
    ----------
    arguments
        Command line with ROS arguments; `sys.argv` by default.
    """
    try:
        messages = importlib.import_module('event_camera_msgs.msg')
    except ImportError:
        print(
            'cannot start: the package event_camera_msgs is not installed '
            '(Ubuntu: ros-jazzy-event-camera-msgs)',
            file=sys.stderr,
        )
        return _NOT_INSTALLED
    command_line = sys.argv if arguments is None else arguments
    return run_plain_node(lambda: PacketBridgeNode(messages.EventPacket), command_line)
