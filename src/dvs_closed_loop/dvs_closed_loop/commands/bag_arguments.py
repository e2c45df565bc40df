"""The arguments by which a command reads a bag, and the bag that they name."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dvs_closed_loop.bags.bag import RecordedBag


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag, and the options that choose loop and topics of it.

    Parameters
    ----------
    parser
        Parser to extend.
    """
    parser.add_argument('bag', type=Path, help='folder of the bag, or one of its files; ROS 1 too')
    parser.add_argument('--from-namespace', help='loop in the bag, where it holds several')
    parser.add_argument(
        '--topic',
        action='append',
        default=[],
        metavar='TOPIC:=NAME',
        help='topic of the wire contract and its name in the bag, as in events:=/dvs/events '
        '(default: by name in whatever namespace, else by type); may be repeated',
    )


def chosen_bag(options: argparse.Namespace, topics: list[str] | None = None) -> RecordedBag:
    """Read the bag that the command line names.

    Parameters
    ----------
    options
        Parsed arguments.
    topics
        Topics of the wire contract to read; None for all.

    Raises
    ------
    ParameterError
        If it can't be read, or it is not clear which topics are meant.
    """
    from dvs_closed_loop.bags.bag import read_bag
    from dvs_closed_loop.bags.loop_topics import given_topics

    bag = read_bag(
        options.bag,
        namespace=options.from_namespace,
        topics=topics,
        given=given_topics(options.topic),
    )
    if bag.damage:
        print(bag.damage, file=sys.stderr)
    return bag
