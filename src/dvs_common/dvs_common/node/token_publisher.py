"""A publisher of what a lockstep partner waits for, whatever QoS it listens with."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

from dvs_common.node.direct_calls import AnyPublisher, raw_sender


class TokenPublisher:
    """Publisher that sends its last message again when a volatile subscriber comes late.

    In lockstep one message is on its way at a time. Latching keeps it for a late reader that asks
    for it; a reader with rclpy's default QoS does not, and both sides would wait for ever.

    Parameters
    ----------
    node
        Node of the publisher.
    publisher
        Publisher of the topic.
    renewed
        Takes a publisher down and returns a new one of the same topic.
    """

    def __init__(
        self,
        node: Node,
        publisher: AnyPublisher,
        renewed: Callable[[AnyPublisher], AnyPublisher],
    ) -> None:
        self._node = node
        self._publisher = publisher
        self._send = raw_sender(publisher)
        self._renewed = renewed
        self._last: bytes | None = None
        self._met: set[bytes] = set()

    def publish(self, message: bytes) -> None:
        """Publish a serialized message.

        Parameters
        ----------
        message
            CDR bytes.
        """
        self._last = message
        self._send(message)

    def forget(self) -> None:
        """Drop what is latched, when time has begun anew: a late reader must not take it for new.

        The middleware gives up the history of a publisher with the publisher alone.
        """
        self._last = None
        self._publisher = self._renewed(self._publisher)
        self._send = raw_sender(self._publisher)

    def look(self) -> None:
        """Send the last message again if a subscriber came that can't have it."""
        found = {
            bytes(info.endpoint_gid)
            for info in self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
            if info.qos_profile.durability == DurabilityPolicy.VOLATILE
        }
        if self._last is not None and found - self._met:
            self._send(self._last)
        self._met = found
