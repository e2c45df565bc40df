"""Subscribes to every topic of a running loop, keeps the messages and writes them to a bag."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.nanoseconds import as_seconds
from dvs_common.node.message_information import WithInformation, publication_ns
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import parse_events
from dvs_common.wire.messages import parse_command, parse_image, parse_state
from dvs_common.wire.stamped import stamp_of

# What the bag of a run holds.
RECORDED = (
    topics.LUMINOSITY,
    topics.EVENTS,
    topics.COMMAND,
    topics.STATE,
    topics.ESTIMATE,
    topics.CLOCK,
    topics.KEYFRAME,
    topics.ANCHOR,
    topics.DIAGNOSTICS,
)
# What a verdict needs.
_NEEDED = (
    topics.LUMINOSITY,
    topics.EVENTS,
    topics.COMMAND,
    topics.STATE,
    topics.ESTIMATE,
)


def _events_of(message: bytes) -> int:
    return len(parse_events(message).events)


def _without_events(parse: Callable[[bytes], object]) -> Callable[[bytes], int]:
    def read(message: bytes) -> int:
        parse(message)
        return 0

    return read


# Number of events in a message; raises `MessageError` for one that can't be read.
_READ: dict[str, Callable[[bytes], int]] = {
    topics.EVENTS: _events_of,
    topics.LUMINOSITY: _without_events(parse_image),
    topics.COMMAND: _without_events(parse_command),
    topics.STATE: _without_events(parse_state),
    topics.ESTIMATE: _without_events(parse_state),
}


# What is sent again to a volatile subscriber that comes late; it carries its stamp.
_SENT_AGAIN = (topics.EVENTS, topics.COMMAND)


class RunRecorder:
    """Subscribes to the loop's topics before its nodes start.

    Parameters
    ----------
    node
        Node that carries the subscriptions.
    mode
        ``lockstep`` or ``realtime``: decides the quality of service.
    bag
        Where the messages go as well.
    """

    def __init__(self, node: Node, mode: str, bag: BagWriter) -> None:
        self._bag = bag
        self._logger = node.get_logger()
        self.messages: dict[str, list[bytes]] = {topic: [] for topic in RECORDED}
        # When the samples came that no command has answered yet, up to the first command.
        self._sample_times_s: dict[int, float] = {}
        self._first_sample_s: float | None = None
        self._last_command_s = 0.0
        self.event_count = 0
        # A plant that does not wait for us may have begun before we received anything.
        self.plant_waited = True
        # A plant of others' may keep its state to itself.
        self.publishes_states = True
        self._subscriptions = {
            topic: node.create_subscription(
                STREAMS[topic].message_type,
                topic,
                WithInformation(self._keeper(topic)),
                _qos(topic, mode),
                raw=True,
            )
            for topic in RECORDED
        }

    def _keeper(self, topic: str) -> Callable[[bytes, Mapping[str, Any]], None]:
        messages = self.messages[topic]

        def keep(message: bytes, information: Mapping[str, Any]) -> None:
            if messages and message == messages[-1] and topic in _SENT_AGAIN:
                return
            self._bag.write(
                topic, time.time_ns(), message, published_ns=publication_ns(information)
            )
            try:
                events = _READ[topic](message) if topic in _READ else 0
            except MessageError as error:
                self._logger.error(
                    f'message on {topic} left out of the verdict: {error}',
                    throttle_duration_sec=5.0,
                )
                return
            messages.append(message)
            self.event_count += events
            if topic == topics.COMMAND:
                self._time_command(message)
            elif topic == topics.LUMINOSITY and self._first_sample_s is None:
                self._sample_times_s.setdefault(stamp_of(message), time.perf_counter())

        return keep

    def _time_command(self, message: bytes) -> None:
        self._last_command_s = time.perf_counter()
        if self._first_sample_s is None:
            times = self._sample_times_s
            self._first_sample_s = times.get(stamp_of(message), self._last_command_s)

    def receives_every_node(self) -> bool:
        """Whether all topics that a verdict needs are matched with their publishers."""
        return self.receives(topics.STATE) and self.receives_all_but_states()

    def receives_all_but_states(self) -> bool:
        """Whether all that any plant, camera and controller have is matched."""
        return all(self.receives(topic) for topic in _NEEDED if topic != topics.STATE)

    def receives(self, topic: str) -> bool:
        """Whether a topic has a publisher.

        Parameters
        ----------
        topic
            Topic of the wire contract.
        """
        return bool(self._subscriptions[topic].get_publisher_count())

    @property
    def count(self) -> int:
        """Number of messages so far."""
        return sum(map(len, self.messages.values()))

    def has(self, samples: int) -> bool:
        """Whether every topic that a verdict needs has been received so often.

        Parameters
        ----------
        samples
            Number of messages on each.
        """
        asked = [t for t in _NEEDED if t != topics.STATE or self.publishes_states]
        return all(len(self.messages[topic]) >= samples for topic in asked)

    @property
    def answered_s(self) -> float:
        """Time from the first sample that was answered to the last, by their stamps, s."""
        commands = self.messages[topics.COMMAND]
        return as_seconds(stamp_of(commands[-1]) - stamp_of(commands[0])) if commands else 0.0

    @property
    def wall_seconds(self) -> float:
        """Wall-clock time from the first sample with a command to the last command, s."""
        return 0.0 if self._first_sample_s is None else self._last_command_s - self._first_sample_s


def _qos(topic: str, mode: str) -> QoSProfile:
    if topic == topics.CLOCK:
        return topics.clock_qos()
    if topic in (topics.EVENTS, topics.COMMAND):
        qos = topics.handshake_qos(mode)
    elif topic == topics.KEYFRAME:
        qos = topics.latched_qos()
    else:
        qos = topics.stream_qos()
    # The loop does not wait for mere subscribers: messages queue up here while we write.
    qos.depth = topics.LISTENER_DEPTH
    return qos
