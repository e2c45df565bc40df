"""Subscribes to the loop's streams and writes what it receives to a bag."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from dvs_closed_loop.bags.recording import BagFullError, BagWriter
from dvs_closed_loop.bags.streams import Stream
from dvs_common.nanoseconds import as_seconds
from dvs_common.node.message_information import WithInformation, publication_ns
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch, Order
from dvs_common.wire.topics import fitting_qos

# rclpy's executor raises on an event of a subscription that is gone, and `adapt` takes
# subscriptions away just when a publisher has made such an event.
_NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)


class BagRecorder:
    """Records streams; a full bag ends it with `failure` set.

    Parameters
    ----------
    node
        Node that carries the subscriptions.
    streams
        What to record.
    bag
        Where to; its topics must be the resolved names of the streams.
    """

    def __init__(self, node: Node, streams: list[Stream], bag: BagWriter) -> None:
        self._node = node
        self._bag = bag
        self.counts = {stream.topic: 0 for stream in streams}
        self.index = IndexWatch()
        # Both have the same events under the same numbers.
        self.watched = next(
            (t for t in (topics.EVENTS, topics.EVENTS_LABEL) if t in self.counts), ''
        )
        self.failure: BagFullError | None = None
        self._last_ns = 0
        self._subscriptions: dict[Stream, Subscription] = {}
        self._matched: set[str] = set()
        for stream in streams:
            qos = stream.offered_qos
            qos.depth = topics.LISTENER_DEPTH
            self._subscribe(stream, qos)

    def adapt(self) -> list[str]:
        """Ask of every stream for what all its publishers offer; return what that costs.

        Some publishers do not latch (realtime mode, a driver), others are best effort (a camera).
        """
        said = []
        for stream, subscription in list(self._subscriptions.items()):
            publishers = self._node.get_publishers_info_by_topic(subscription.topic_name)
            asked = subscription.qos_profile
            offered = fitting_qos(asked, [info.qos_profile for info in publishers])
            if offered == asked:
                continue
            self._node.destroy_subscription(subscription)
            self._subscribe(stream, offered)
            if offered.reliability != asked.reliability:
                said.append(
                    f'{stream.topic} has a publisher with best-effort QoS: recorded best effort, '
                    'what is lost on the way is not sent again'
                )
        return said

    def newly_received(self) -> list[str]:
        """Topics whose first publisher has been matched since the last call."""
        found = {s.topic for s, own in self._subscriptions.items() if own.get_publisher_count()}
        new = found - self._matched
        self._matched |= new
        return sorted(new)

    def _subscribe(self, stream: Stream, qos: QoSProfile) -> None:
        self._subscriptions[stream] = self._node.create_subscription(
            stream.message_type,
            stream.topic,
            WithInformation(self._keeper(stream)),
            qos,
            raw=True,
            event_callbacks=_NO_EVENTS,
        )

    def keep_up(self) -> None:
        """Write what has waited where no other message comes."""
        try:
            self._bag.keep_up()
        except BagFullError as error:
            self.failure = error

    def keep_scenario(self, scenario: Scenario, name: str) -> None:
        """Store the parameters of the run; see `BagWriter.keep_scenario`.

        Parameters
        ----------
        scenario
            Parameters of the run.
        name
            Name of the scenario.
        """
        try:
            self._bag.keep_scenario(scenario, name)
        except BagFullError as error:
            self.failure = error

    def _keeper(self, stream: Stream) -> Callable[[bytes, Mapping[str, Any]], None]:
        name = self._node.resolve_topic_name(stream.topic)

        def keep(message: bytes, information: Mapping[str, Any]) -> None:
            if self.failure is not None:
                return
            # Readers of an MCAP file without an index want times that never go back.
            self._last_ns = max(self._last_ns, time.time_ns())
            try:
                self._bag.write(
                    name, self._last_ns, message, published_ns=publication_ns(information)
                )
            except BagFullError as error:
                self.failure = error
                return
            self.counts[stream.topic] += 1
            if stream.topic == self.watched:
                self._watch(message)

        return keep

    def _watch(self, message: bytes) -> None:
        try:
            packet = parse_events(message)
        except MessageError as error:
            self._node.get_logger().warning(
                f'recorded as it is, though it is no event packet: {error}',
                throttle_duration_sec=5.0,
            )
            return
        step = self.index.take(packet)
        if step.order is Order.IN_ORDER:
            return
        before = f'before {as_seconds(packet.stamp_ns):.6f} s'
        if step.order is Order.LOST:
            self._node.get_logger().error(
                f'{step.lost} events are missing {before} ({self.index.lost} in all)'
            )
        else:
            self._node.get_logger().warning(f'{step.order.value}, {before}')
