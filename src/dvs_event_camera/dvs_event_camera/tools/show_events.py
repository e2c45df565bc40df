"""Tool `show_events`: x y t p of events as a table, live or from a bag, and their statistics."""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EventPacket
from dvs_event_camera.streams.event_bag import bag_packets
from dvs_event_camera.streams.event_sinks import CsvSink, EventSink, NpzSink, TextSink
from dvs_event_camera.tools.event_show import EventShow

_USAGE_ERROR = 2


def parse_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Command line of `show_events`.

    Parameters
    ----------
    arguments
        Without ROS arguments and the program's name.
    """
    parser = argparse.ArgumentParser(
        prog='show_events',
        description='Print events as a table x y t p: column, row, time in ns, polarity. '
        'Statistics go to stderr.',
    )
    parser.add_argument('bag', nargs='?', type=Path, help='rosbag2 folder; without it: live')
    parser.add_argument('--topic', default='events', help='topic (default: events)')
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write a CSV file instead')
    parser.add_argument('--npz', type=Path, metavar='FILE', help='write a NumPy archive instead')
    parser.add_argument('--limit', type=int, metavar='N', help='stop after N events')
    parser.add_argument(
        '--seconds', type=float, metavar='S', help='stop after S seconds of events'
    )
    parser.add_argument('--quiet', action='store_true', help='statistics only')
    return parser.parse_args(arguments)


def sinks_of(options: argparse.Namespace) -> list[EventSink]:
    """Sinks that the command line asks for.

    Parameters
    ----------
    options
        From `parse_arguments`.
    """
    sinks: list[EventSink] = []
    if options.csv:
        sinks.append(CsvSink(options.csv))
    if options.npz:
        sinks.append(NpzSink(options.npz))
    if not sinks and not options.quiet:
        sinks.append(TextSink(sys.stdout))
    return sinks


def show_bag(packets: Iterator[tuple[float, EventPacket]], show: EventShow) -> None:
    """Show the packets of a bag.

    Parameters
    ----------
    packets
        From `bag_packets`.
    show
        Where they go.
    """
    for received_s, packet in packets:
        show.add(packet, received_s)
        if show.done:
            return


def main(arguments: Sequence[str] | None = None) -> int:
    """Show events; returns the exit code.

    Parameters
    ----------
    arguments
        Command line with ROS arguments; `sys.argv` by default.
    """
    command_line = list(sys.argv if arguments is None else arguments)
    own = command_line[1:]
    if '--ros-args' in own:
        own = own[: own.index('--ros-args')]
    options = parse_arguments(own)
    try:
        return _show(options, command_line)
    except BrokenPipeError:  # `show_events BAG | head` is how people look
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ParameterError, MessageError) as error:
        print(f'show_events: {error}', file=sys.stderr)
    except OSError as error:
        print(f'show_events: {error.filename}: {error.strerror}', file=sys.stderr)
    return _USAGE_ERROR


def _show(options: argparse.Namespace, command_line: Sequence[str]) -> int:
    for name, value in (('limit', options.limit), ('seconds', options.seconds)):
        if value is not None and not 0 <= value < math.inf:
            raise ParameterError(name, value, 'must be a finite number >= 0')
    sinks = sinks_of(options)
    show = EventShow(sinks, options.limit, options.seconds)
    exit_code = 0
    try:
        if options.bag:
            show_bag(bag_packets(options.bag, options.topic), show)
        else:
            # Only here ROS is needed.
            live = importlib.import_module('dvs_event_camera.tools.show_events_node')
            exit_code = live.show_live(options.topic, show, command_line)
    finally:
        for sink in sinks:
            sink.close()
    print(show.statistics.report(), file=sys.stderr)
    return exit_code
