"""A subscription that asks for no more than the publishers of its topic offer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from dvs_common.wire.topics import fitting_qos


class FittingSubscription:
    """Subscribes anew where no publisher offers what was asked for.

    Parameters
    ----------
    node
        Node that carries the subscription.
    subscribe
        Makes it with a quality of service; what it made before is destroyed first.
    qos
        What it would rather have.
    """

    def __init__(
        self, node: Node, subscribe: Callable[[QoSProfile], Subscription[Any]], qos: QoSProfile
    ) -> None:
        self._node = node
        self._subscribe = subscribe
        self._qos = qos
        self.subscription = subscribe(qos)

    def look(self) -> str:
        """Ask for less where that is all there is; return what it costs, empty if nothing."""
        if self.subscription.get_publisher_count():
            return ''
        topic = self.subscription.topic_name
        publishers = self._node.get_publishers_info_by_topic(topic)
        if not publishers:
            return ''
        qos = fitting_qos(self._qos, [info.qos_profile for info in publishers])
        asked = self.subscription.qos_profile
        if (qos.reliability, qos.durability) == (asked.reliability, asked.durability):
            return ''
        self._node.destroy_subscription(self.subscription)
        self.subscription = self._subscribe(qos)
        if qos.reliability == ReliabilityPolicy.BEST_EFFORT:
            return (
                f'{topic} has a publisher with best-effort QoS: taken best effort, what is lost '
                'on the way is not sent again'
            )
        return f'{topic} has a publisher that does not latch: what it sent before is not received'
