"""What the replay of a recording waits for: subscribers, the next instant, the arrival."""

from __future__ import annotations

import math
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from dvs_closed_loop.running.tool import Tool

_WAIT_TURN_S = 0.1
_NAME_MISSING_AFTER_S = 2.0
# Shorter than this, a pause costs more than it is worth.
_SHORTEST_PAUSE_S = 2e-4
_LAST_WORDS_S = 5


def wait_for_subscribers(
    tool: Tool, publishers: dict[str, Publisher], *, every_topic: bool
) -> None:
    """Wait until a topic has a subscriber, or every one has.

    Parameters
    ----------
    tool
        Node of the tool.
    publishers
        Publishers by topic.
    every_topic
        Whether to wait for subscribers of all of them.
    """
    said_at = time.monotonic() + _NAME_MISSING_AFTER_S
    while not tool.stop.received:
        lonely = [t for t, p in publishers.items() if not p.get_subscription_count()]
        if not lonely or (len(lonely) < len(publishers) and not every_topic):
            return
        if time.monotonic() > said_at:
            print(f'waiting for subscribers of {", ".join(lonely)}', file=sys.stderr, flush=True)
            said_at = math.inf
        tool.spin(_WAIT_TURN_S)


def pause_until(deadline: float, tool: Tool) -> None:
    """Sleep until an instant or a signal.

    Parameters
    ----------
    deadline
        Instant of the monotonic clock, s.
    tool
        Node of the tool.
    """
    while (left := deadline - time.monotonic()) > _SHORTEST_PAUSE_S and not tool.stop.received:
        time.sleep(min(left, _WAIT_TURN_S))


def let_arrive(publishers: dict[str, Publisher], tool: Tool) -> None:
    """Wait until the last messages have arrived.

    Parameters
    ----------
    publishers
        Publishers by topic.
    tool
        Node of the tool.
    """
    from rclpy.duration import Duration

    if not tool.stop.received:
        for publisher in publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=_LAST_WORDS_S))
