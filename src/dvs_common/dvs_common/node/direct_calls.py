"""Calls in place of messages between the nodes of one process, while no other subscribes."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

_Handler = Callable[[bytes], None]
# How long calls may follow each other before signals, timers and the middleware have their turn.
_LONGEST_RUN_S = 0.02


class DirectCalls:
    """Hands serialized messages from node to node, in the order in which they were published.

    Once another process subscribes to one of the topics, all go through the middleware, and
    remain there: what is latched then is in the history of the middleware alone. The last message
    of each latched topic that it has not had yet is published to it at that moment.
    """

    def __init__(self) -> None:
        self._handlers: dict[str, list[_Handler]] = {}
        self._publishers: list[DirectPublisher] = []
        self._pending: deque[tuple[_Handler, bytes]] = deque()
        self._is_over = False

    def publisher(self, publisher: Publisher, qos: QoSProfile) -> DirectPublisher:
        """Publisher whose messages take the fast path where there is one.

        Parameters
        ----------
        publisher
            Publisher of the topic.
        qos
            Its quality of service.
        """
        made = DirectPublisher(self, publisher, is_latched=_is_latched(qos))
        self._publishers.append(made)
        return made

    def retract(self, publisher: DirectPublisher) -> None:
        """Forget a publisher that is taken down.

        Parameters
        ----------
        publisher
            What `publisher` returned.
        """
        self._publishers.remove(publisher)

    def subscribe(self, subscription: Subscription, handler: _Handler, qos: QoSProfile) -> None:
        """Call a handler with the messages of a topic.

        Parameters
        ----------
        subscription
            The same by the middleware.
        handler
            Called with the CDR bytes of each message.
        qos
            Its quality of service: a latched message is handed on to who comes late.
        """
        topic = subscription.topic_name
        self._handlers.setdefault(topic, []).append(handler)
        if _is_latched(qos):
            self._pending.extend(
                (handler, publisher.withheld)
                for publisher in self._publishers
                if publisher.topic_name == topic and publisher.withheld is not None
            )

    def ignore(self, subscription: Subscription, handler: _Handler) -> None:
        """Call a handler no more.

        Parameters
        ----------
        subscription
            The subscription that is taken down.
        handler
            Its handler.
        """
        self._handlers[subscription.topic_name].remove(handler)
        kept = [call for call in self._pending if call[0] is not handler]
        self._pending = deque(kept)

    def handlers(self, topic: str) -> list[_Handler]:
        """Return who is to be called with a message of a topic; none where it is to be sent.

        Parameters
        ----------
        topic
            Full name.
        """
        return [] if self._is_over else self._handlers.get(topic, [])

    def call(self, handler: _Handler, message: bytes) -> None:
        """Call a handler once those before it have returned.

        Parameters
        ----------
        handler
            Handler of the topic.
        message
            CDR bytes.
        """
        self._pending.append((handler, message))

    def run(self) -> bool:
        """Make the calls that wait and those that follow from them, for 20 ms at most.

        Returns
        -------
        bool
            Whether some are left.
        """
        if not self._is_over:
            self._look()
        pending = self._pending
        deadline = time.perf_counter() + _LONGEST_RUN_S
        while pending and time.perf_counter() < deadline:
            handler, message = pending.popleft()
            handler(message)
            pending = self._pending
        return bool(pending)

    def _look(self) -> None:
        """End the fast path if another process subscribes, or one of ours can't be reached."""
        for publisher in self._publishers:
            ours = len(self._handlers.get(publisher.topic_name, ()))
            if ours and publisher.get_subscription_count() != ours:
                self._is_over = True
        if self._is_over:
            for publisher in self._publishers:
                publisher.catch_up()


class DirectPublisher:
    """Publisher that leaves the middleware out while it can; see `DirectCalls`.

    Parameters
    ----------
    calls
        The nodes of this process.
    publisher
        Publisher of the topic.
    is_latched
        Whether its last message waits for late subscribers.
    """

    def __init__(self, calls: DirectCalls, publisher: Publisher, *, is_latched: bool) -> None:
        self._calls = calls
        self.publisher = publisher
        self.topic_name: str = publisher.topic_name
        self._is_latched = is_latched
        # The last message of a latched topic, while the middleware has not had it.
        self.withheld: bytes | None = None

    def get_subscription_count(self) -> int:
        """Return how many subscriptions the middleware has matched, those of this process too."""
        return int(self.publisher.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Publish a message object or a serialized one; only the latter takes the fast path.

        Parameters
        ----------
        message
            What to publish.
        """
        handlers = self._calls.handlers(self.topic_name) if isinstance(message, bytes) else []
        for handler in handlers:
            self._calls.call(handler, message)
        self.withheld = message if handlers and self._is_latched else None
        if not handlers:
            self.publisher.publish(message)

    def catch_up(self) -> None:
        """Publish to the middleware what it has not had."""
        if self.withheld is not None:
            self.publisher.publish(self.withheld)
            self.withheld = None


AnyPublisher: TypeAlias = Publisher | DirectPublisher


def raw_sender(publisher: AnyPublisher) -> Callable[[bytes], None]:
    """Return what publishes serialized messages without a look at what they are.

    Parameters
    ----------
    publisher
        Publisher of the topic.
    """
    if isinstance(publisher, DirectPublisher):
        return publisher.publish
    send: Callable[[bytes], None] = publisher.handle.publish_raw
    return send


def _is_latched(qos: QoSProfile) -> bool:
    return bool(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)
