"""Command `dvs_closed_loop latency`: where the time of a cycle goes, from the times in a bag."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dvs_closed_loop.bags.bag import RecordedBag
from dvs_closed_loop.commands.bag_arguments import add_bag_arguments, chosen_bag
from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.stamped import stamp_of

# A cycle passes these topics in this order; each message begins with the sample's stamp.
_PATH = (topics.LUMINOSITY, topics.EVENTS, topics.COMMAND)


@dataclass(frozen=True, slots=True, kw_only=True)
class StageLatency:
    """Times from one message of a cycle to a later one.

    Parameters
    ----------
    start
        Topic of the earlier message.
    end
        Topic of the later message.
    times_s
        One entry a cycle, s, shape (K,); as the recorder received them, so that single entries
        carry its own jitter.
    """

    start: str
    end: str
    times_s: FloatArray

    def __str__(self) -> str:
        """Return median, 99th percentile and maximum in ms."""
        values = (*np.percentile(self.times_s, (50, 99)), self.times_s.max())
        figures = '  '.join(f'{value * 1e3:9.3f}' for value in values)
        return f'{self.start + " -> " + self.end:<24}{figures}'


def stage_latencies(bag: RecordedBag) -> list[StageLatency]:
    """Latency of camera and transport, of controller and transport, and of both.

    Parameters
    ----------
    bag
        Messages of a run.

    Raises
    ------
    ParameterError
        If the bag holds no cycle from luminosity to command.
    """
    received = {topic: _first_reception(bag, topic) for topic in _PATH}
    stamps = sorted(set.intersection(*(set(times) for times in received.values())))
    if not stamps:
        raise ParameterError('bag', bag.path, 'holds no cycle from luminosity to command')
    return [
        StageLatency(
            start=start,
            end=end,
            times_s=as_seconds(np.array([received[end][s] - received[start][s] for s in stamps])),
        )
        for start, end in (*pairwise(_PATH), (_PATH[0], _PATH[-1]))
    ]


def _first_reception(bag: RecordedBag, topic: str) -> dict[int, int]:
    received: dict[int, int] = {}
    for message in bag.messages:
        if message.topic == topic:
            with suppress(MessageError):
                received.setdefault(stamp_of(message.data), message.received_ns)
    return received


def table(latencies: Sequence[StageLatency]) -> str:
    """Readable table of latencies.

    Parameters
    ----------
    latencies
        Stages of a cycle.
    """
    cycles = latencies[0].times_s.size
    header = f'{"[ms]":<24}{"median":>9}  {"99 %":>9}  {"max":>9}   ({cycles} cycles)'
    return '\n'.join((header, *map(str, latencies)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line.

    Parameters
    ----------
    parser
        Parser of the subcommand.
    """
    add_bag_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Print the table; return the exit code.

    Parameters
    ----------
    options
        Parsed command line.
    """
    print(table(stage_latencies(chosen_bag(options))))
    return 0
