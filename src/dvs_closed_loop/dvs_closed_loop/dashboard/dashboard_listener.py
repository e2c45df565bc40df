"""Subscribes a live view to the loop's topics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from dvs_closed_loop.bags.streams import STREAMS
from dvs_closed_loop.dashboard.live_view import LiveView
from dvs_common.node.fitting_subscription import FittingSubscription
from dvs_common.wire import topics

_DEPTH = 1000


class DashboardListener:
    """Subscriptions of the live page, fed from now on: reliable where the publisher is.

    Parameters
    ----------
    node
        Node that carries the subscriptions.
    view
        What receives the messages.
    """

    def __init__(self, node: Node, view: LiveView) -> None:
        self._node = node
        self._fitting: list[FittingSubscription] = []
        self._plants: set[bytes] = set()
        for topic in view.topics:
            qos = topics.stream_qos()
            qos.depth = _DEPTH
            self._fitting.append(FittingSubscription(node, _subscriber(node, view, topic), qos))

    def look(self) -> None:
        """Ask for no more than publishers offer, with a warning where that costs something."""
        for fitting in self._fitting:
            if costs := fitting.look():
                self._node.get_logger().warning(costs)

    def finds_another_plant(self) -> bool:
        """Whether all publishers of plants that there were are gone and others are there."""
        plants = {
            bytes(info.endpoint_gid)
            for topic in (topics.LUMINOSITY, topics.STATE)
            for info in self._node.get_publishers_info_by_topic(
                self._node.resolve_topic_name(topic)
            )
        }
        is_another = bool(plants and self._plants and not plants & self._plants)
        self._plants = plants or self._plants
        return is_another


def _subscriber(
    node: Node, view: LiveView, topic: str
) -> Callable[[QoSProfile], Subscription[Any]]:
    def subscribe(qos: QoSProfile) -> Subscription[Any]:
        kind = STREAMS[topic].message_type
        return node.create_subscription(kind, topic, _listener(view, topic), qos, raw=True)

    return subscribe


def _listener(view: LiveView, topic: str) -> Callable[[bytes], None]:
    def receive(message: bytes) -> None:
        view.receive(topic, message)

    return receive
