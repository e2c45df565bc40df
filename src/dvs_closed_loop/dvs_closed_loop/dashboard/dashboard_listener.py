"""Subscribes a live view to the loop's topics."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from dvs_closed_loop.bags.streams import STREAMS
from dvs_closed_loop.dashboard.live_view import LiveView
from dvs_common.wire import topics

_DEPTH = 1000


class DashboardListener:
    """Subscriptions of the live page: reliable, and fed from now on only.

    Parameters
    ----------
    node
        Node that carries the subscriptions.
    view
        What receives the messages.
    """

    def __init__(self, node: Node, view: LiveView) -> None:
        for topic in view.topics:
            qos = topics.stream_qos()
            qos.depth = _DEPTH
            node.create_subscription(
                STREAMS[topic].message_type, topic, _listener(view, topic), qos, raw=True
            )


def _listener(view: LiveView, topic: str) -> Callable[[bytes], None]:
    def listen(message: bytes) -> None:
        view.receive(topic, message)

    return listen
