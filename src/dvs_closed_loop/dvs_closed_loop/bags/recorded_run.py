"""What a bag says about a run, also where the recording began late or lost something."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from dvs_closed_loop.bags.bag import RecordedBag, RecordedMessage
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.wire import topics
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.stamped import stamp_of
from dvs_simulation.judging.trace import Messages, Trace, decode_trace

# Streams that have one message for every sample, stamped with its time.
STAMPED = (topics.LUMINOSITY, topics.EVENTS, topics.COMMAND, topics.STATE)


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamStatistics:
    """What was recorded of one topic.

    Parameters
    ----------
    topic
        Full name in the bag.
    type_name
        Message type.
    messages
        Number of messages.
    rate_hz
        Mean rate of reception, Hz.
    longest_pause_s
        Longest time between two messages, s.
    size_bytes
        Bytes of all messages.
    missing
        Samples of the run that this topic lacks between its first and its last message; None where
        its messages carry no stamp.
    """

    topic: str
    type_name: str
    messages: int
    rate_hz: float
    longest_pause_s: float
    size_bytes: int
    missing: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """The last run in a bag.

    Parameters
    ----------
    streams
        Statistics by topic of the wire contract.
    index
        Events and their losses.
    runs
        Runs in the bag: one more than the times at which the stamps went back.
    trace
        Signals on the samples of which everything was recorded, or None if there are none.
    from_start
        Whether `trace` begins with the first sample of the run.
    wall_seconds
        Wall-clock time from the first sample with a command to the last command, s.
    """

    streams: dict[str, StreamStatistics]
    index: IndexWatch
    runs: int
    trace: Trace | None
    from_start: bool
    wall_seconds: float


def examine(bag: RecordedBag) -> RecordedRun:
    """Statistics and the last run of a bag.

    Parameters
    ----------
    bag
        Messages of one loop.

    Raises
    ------
    MessageError
        If a message breaks the wire contract.
    """
    index = IndexWatch()
    for message in bag.of(topics.EVENTS):
        index.take(parse_events(message))
    last, runs = _last_run(bag)
    stamps = {topic: [stamp_of(m.data) for m in last.get(topic, [])] for topic in STAMPED}
    streams = {
        topic: _statistics(topic, name, bag, stamps) for topic, name in sorted(bag.names.items())
    }
    complete = _complete_messages(last, stamps)
    trace = decode_trace(complete) if complete[topics.COMMAND] else None
    starts = {values[0] for values in stamps.values() if values}
    began = stamp_of(complete[topics.COMMAND][0]) if trace is not None else None
    return RecordedRun(
        streams=streams,
        index=index,
        runs=runs,
        trace=trace,
        from_start=starts == {began} and index.first_index in (None, 0),
        wall_seconds=_wall_seconds(last),
    )


def _wall_seconds(last: dict[str, list[RecordedMessage]]) -> float:
    commands = last.get(topics.COMMAND, [])
    if not commands:
        return 0.0
    first = stamp_of(commands[0].data)
    samples = (m for m in last.get(topics.LUMINOSITY, []) if stamp_of(m.data) == first)
    begin = next(samples, commands[0])
    return max(0, commands[-1].received_ns - begin.received_ns) * 1e-9


def _last_run(bag: RecordedBag) -> tuple[dict[str, list[RecordedMessage]], int]:
    """Messages by topic after the stamps went back for the last time, and the number of runs."""
    by_topic: dict[str, list[RecordedMessage]] = {}
    for message in bag.messages:
        by_topic.setdefault(message.topic, []).append(message)
    jumps = 0
    began_ns = None
    for topic in STAMPED:
        messages = by_topic.get(topic, [])
        stamps = np.array([stamp_of(message.data) for message in messages], dtype=np.int64)
        back = np.flatnonzero(np.diff(stamps) < 0) + 1
        jumps = max(jumps, back.size)
        if back.size:
            by_topic[topic] = messages[back[-1] :]
            received_ns = by_topic[topic][0].received_ns
            began_ns = received_ns if began_ns is None else min(began_ns, received_ns)
    if began_ns is not None and topics.ESTIMATE in by_topic:
        times = [message.received_ns for message in by_topic[topics.ESTIMATE]]
        by_topic[topics.ESTIMATE] = by_topic[topics.ESTIMATE][bisect_left(times, began_ns) :]
    return by_topic, jumps + 1


def _statistics(
    topic: str, name: str, bag: RecordedBag, stamps: dict[str, list[int]]
) -> StreamStatistics:
    messages = [message for message in bag.messages if message.topic == topic]
    times = np.array([message.received_ns for message in messages], dtype=np.int64)
    pauses = np.diff(times) * 1e-9
    seconds = float(pauses.sum())
    missing = None
    if stamps.get(topic):
        own = set(stamps[topic])
        first, last = stamps[topic][0], stamps[topic][-1]
        samples = {s for values in stamps.values() for s in values if first <= s <= last}
        missing = len(samples - own)
    return StreamStatistics(
        topic=name,
        type_name=STREAMS[topic].type_name,
        messages=len(messages),
        rate_hz=len(pauses) / seconds if seconds else 0.0,
        longest_pause_s=float(pauses.max(initial=0.0)),
        size_bytes=sum(len(message.data) for message in messages),
        missing=missing,
    )


def _complete_messages(
    run: dict[str, list[RecordedMessage]], stamps: dict[str, list[int]]
) -> Messages:
    """Messages of the samples that every stream has, one command and estimate a sample."""
    samples = set.intersection(*(set(stamps[topic]) for topic in STAMPED))
    commands = run.get(topics.COMMAND, [])
    estimates = _align(run.get(topics.ESTIMATE, []), commands)
    kept_commands, kept_estimates = [], []
    for stamp, command, estimate in zip(stamps[topics.COMMAND], commands, estimates, strict=True):
        if stamp in samples and estimate is not None:
            samples.discard(stamp)
            kept_commands.append(command.data)
            kept_estimates.append(estimate.data)
    others = {t: [m.data for m in run.get(t, [])] for t in STAMPED if t != topics.COMMAND}
    return {**others, topics.COMMAND: kept_commands, topics.ESTIMATE: kept_estimates}


def _align(
    estimates: list[RecordedMessage], commands: list[RecordedMessage]
) -> list[RecordedMessage | None]:
    """Estimate that belongs to each command.

    Estimates carry no stamp, but the controller publishes one just before each command. So they
    belong together in order, shifted by as many as the recording missed of either at its
    beginning; the shift is the one that brings their times of reception closest.
    """
    if not estimates:
        return [None] * len(commands)
    reach = abs(len(estimates) - len(commands)) + 1
    received = np.array([message.received_ns for message in estimates])
    answered = np.array([message.received_ns for message in commands])

    def distance(shift: int) -> float:
        first, last = max(0, -shift), min(len(commands), len(estimates) - shift)
        if first >= last:
            return np.inf
        apart = answered[first:last] - received[first + shift : last + shift]
        return float(np.median(np.abs(apart)))

    shift = min(sorted(range(-reach, reach + 1), key=abs), key=distance)
    if len(estimates) == len(commands):
        shift = 0
    return [
        estimates[i + shift] if 0 <= i + shift < len(estimates) else None
        for i in range(len(commands))
    ]
