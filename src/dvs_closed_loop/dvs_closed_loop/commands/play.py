"""Publish a recording again: a loop's recorded bytes, or a sensor's events, as they were spaced.

Topics, types and quality of service are those of the wire contract. Events of a driver's bag or
of a file are published as `events`, in the time of the sensor. Ends with the recording or Ctrl-C.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import TYPE_CHECKING

from dvs_closed_loop.commands.bag_arguments import add_bag_arguments, chosen_bag
from dvs_closed_loop.commands.play_waits import (
    let_arrive,
    pause_until,
    wait_for_subscribers,
)
from dvs_common.nanoseconds import as_seconds

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from dvs_closed_loop.bags.bag import RecordedBag
    from dvs_closed_loop.bags.streams import Stream
    from dvs_closed_loop.running.tool import Tool

_SETTLE_S = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `play`.

    Parameters
    ----------
    parser
        Parser to extend.
    """
    add_bag_arguments(parser)
    parser.add_argument('--rate', type=float, default=1.0, help='speed relative to the recording')
    parser.add_argument(
        '--topics', nargs='+', metavar='TOPIC', help='topics of the wire contract (default: all)'
    )
    waiting = parser.add_mutually_exclusive_group()
    waiting.add_argument(
        '--wait',
        action='store_true',
        help='begin when every played topic has a subscriber (default: when one has)',
    )
    waiting.add_argument(
        '--no-wait', action='store_true', help='begin before any topic has a subscriber'
    )
    parser.add_argument(
        '--delay', type=float, default=0.0, help='seconds to wait before the first message'
    )
    parser.add_argument('--namespace', default='', help='namespace to publish into')
    parser.add_argument(
        '--region',
        nargs=4,
        type=int,
        default=(),
        metavar=('X', 'Y', 'WIDTH', 'HEIGHT'),
        help='part of the sensor to play, of a recording of a sensor',
    )
    parser.add_argument(
        '--binning', type=int, default=1, help='sensor pixels a side that make one of the loop'
    )


def run(options: argparse.Namespace) -> int:
    """Play until the end of the bag; returns the exit code.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    SuiteError
        If the bag can't be read or an argument breaks its rule.
    """
    from dvs_closed_loop.bags.streams import STREAMS, chosen_streams
    from dvs_closed_loop.commands.play_recording import play_recording
    from dvs_closed_loop.running.tool import tool_node
    from dvs_common.errors import ParameterError
    from dvs_common.wire import topics
    from dvs_event_camera.files.open_recording import is_sensor_recording

    if not (math.isfinite(options.rate) and options.rate > 0):
        raise ParameterError('rate', options.rate, 'must be a finite number > 0')
    if not (math.isfinite(options.delay) and options.delay >= 0):
        raise ParameterError('delay', options.delay, 'must be a finite number >= 0')
    if options.topics is not None:
        chosen_streams(options.topics)
    if options.topics in (None, [topics.EVENTS]) and is_sensor_recording(options.bag):
        return play_recording(options)
    bag = chosen_bag(options, options.topics)
    if not bag.messages:
        raise ParameterError('topics', options.topics, f'have no messages in {options.bag}')
    with tool_node('bag_player', options.namespace, options.ros_arguments) as tool:
        publishers = {
            topic: _publisher(tool, STREAMS[topic], bag)
            for topic in sorted({message.topic for message in bag.messages})
        }
        if not options.no_wait:
            wait_for_subscribers(tool, publishers, every_topic=options.wait)
        tool.spin(max(_SETTLE_S, options.delay))
        sent = _play(bag, publishers, tool, options.rate)
        let_arrive(publishers, tool)
    print(f'{options.bag}: {sent} of {len(bag.messages)} messages played')
    return 0


def _publisher(tool: Tool, stream: Stream, bag: RecordedBag) -> Publisher:
    from dvs_common.wire.topics import history_depth

    qos = stream.offered_qos
    if qos.depth > 1:
        qos.depth = history_depth(max(map(len, bag.of(stream.topic))))
    return tool.node.create_publisher(stream.message_type, stream.topic, qos)


def _play(bag: RecordedBag, publishers: dict[str, Publisher], tool: Tool, rate: float) -> int:
    """Publish every message at its instant; return how many were published."""
    from tqdm import tqdm

    first_ns = bag.messages[0].received_ns
    started = time.monotonic()
    with tqdm(
        total=round(bag.duration_s, 2),
        desc='playing',
        bar_format='{desc} {percentage:3.0f}% |{bar}| {n:.1f}/{total:.1f} s',
        file=sys.stderr,
        disable=None,
    ) as bar:
        for sent, message in enumerate(bag.messages):
            due_s = as_seconds(message.received_ns - first_ns)
            pause_until(started + due_s / rate, tool)
            if tool.stop.received:
                return sent
            publishers[message.topic].publish(message.data)
            if due_s - bar.n > 0.1:
                bar.update(due_s - bar.n)
        bar.update(max(bag.duration_s - bar.n, 0))
    return len(bag.messages)
