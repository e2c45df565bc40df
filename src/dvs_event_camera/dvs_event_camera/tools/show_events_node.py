"""Node `show_events`: the live part of the tool of that name."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from dvs_common.node.fitting_subscription import FittingSubscription
from dvs_common.node.session import ros_session
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_event_camera.files.bag_recording import CloudDecoder
from dvs_event_camera.tools.event_show import EventShow

_REPORT_S = 1.0


class ShowEventsNode(Node):
    """Shows the packets of a topic, with a line of statistics every second.

    Parameters
    ----------
    topic
        Topic of type sensor_msgs/PointCloud2.
    show
        Where packets go.
    """

    def __init__(self, topic: str, show: EventShow) -> None:
        super().__init__('show_events')
        self._show = show
        self._decoder = CloudDecoder()
        self._next_report = time.monotonic() + _REPORT_S

        def subscribe(qos: QoSProfile) -> Subscription[Any]:
            return self.create_subscription(PointCloud2, topic, self._take, qos, raw=True)

        self._fitting = FittingSubscription(self, subscribe, topics.stream_qos())

    def _take(self, message: bytes) -> None:
        try:
            self._show.add(self._decoder.decode(message, time.time_ns()))
        except MessageError as error:
            self.get_logger().error(f'message refused: {error}', throttle_duration_sec=5.0)

    def turn(self) -> bool:
        """Report when it is time; return whether there is more to show."""
        if time.monotonic() >= self._next_report and not self._show.done:
            self._next_report += _REPORT_S
            if costs := self._fitting.look():
                self.get_logger().warning(costs)
            print(self._show.statistics.report(), file=sys.stderr, flush=True)
            self._show.statistics.reset()
        return not self._show.done


def show_live(topic: str, show: EventShow, arguments: Sequence[str]) -> None:
    """Show packets as they come until a signal or the limit.

    Parameters
    ----------
    topic
        Topic of type sensor_msgs/PointCloud2.
    show
        Where they go.
    arguments
        Command line with ROS arguments.

    Raises
    ------
    ParameterError
        If ROS refuses the arguments or the domain.
    """
    with ros_session(arguments) as ros:
        node = ros.add(ShowEventsNode(topic, show))
        while not ros.ended and node.turn():
            ros.turn()
