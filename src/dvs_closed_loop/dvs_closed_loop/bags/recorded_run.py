"""What a bag says about a run, also where the recording began late, lost or mixed something."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dvs_closed_loop.bags.bag import RecordedBag, RecordedMessage
from dvs_closed_loop.bags.stamped_runs import StampedRun, StampedStream, stamped_stream
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.messages import parse_array, parse_command, parse_state
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_simulation.judging.trace import Messages, Trace, decode_trace

# Streams that have one message for every sample, stamped with its time.
STAMPED: Mapping[str, Callable[[bytes], object]] = {
    topics.LUMINOSITY: lambda message: parse_luminosity(message).pixels.shape,
    topics.EVENTS: lambda message: parse_events(message).events.dtype,
    topics.COMMAND: lambda message: parse_command(message).values.size,
    topics.STATE: lambda message: parse_state(message).values.size,
}


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
        Samples of the run that this topic lacks between its first and its last message, though
        other topics have them; None where its messages carry no stamp.
    late
        Messages that were recorded after one with a later stamp.
    repeated
        Messages left out since their stamp was there already.
    unreadable
        Messages left out since they break the wire contract or differ in size.
    """

    topic: str
    type_name: str
    messages: int
    rate_hz: float
    longest_pause_s: float
    size_bytes: int
    missing: int | None
    late: int = 0
    repeated: int = 0
    unreadable: int = 0

    @property
    def troubles(self) -> list[str]:
        """What was read around, one line each."""
        told = (
            (self.unreadable, 'break the wire contract or differ in size, and are left out'),
            (self.late, 'were recorded out of order and are put in order'),
            (self.repeated, 'were recorded again and are left out'),
        )
        lines = [f'{self.topic}: {count} messages {what}' for count, what in told if count]
        if self.missing:
            lines.append(
                f'{self.topic}: {self.missing} samples that other topics have are missing: '
                'lost by the recorder, not by the loop'
            )
        return lines


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

    @property
    def troubles(self) -> list[str]:
        """What was read around, one line each, and how much of the bag was left out."""
        lines = [line for stream in self.streams.values() for line in stream.troubles]
        if self.runs > 1:
            lines.append(f'the bag holds {self.runs} runs; this is the last one')
        if self.index.lost:
            lines.append(f'{self.index.lost} events are missing in {self.index.gaps} gaps')
        restarts = self.index.restarts - (self.runs - 1)
        if restarts > 0:
            lines.append(
                f'the index of the events went back: the camera started again ({restarts})'
            )
        return lines


def examine(bag: RecordedBag) -> RecordedRun:
    """Statistics and the last run of a bag.

    Parameters
    ----------
    bag
        Messages of one loop.
    """
    by_topic: dict[str, list[RecordedMessage]] = {topic: [] for topic in bag.names}
    for message in bag.messages:
        by_topic[message.topic].append(message)
    stamped = {topic: stamped_stream(by_topic.get(topic, []), STAMPED[topic]) for topic in STAMPED}
    index = IndexWatch()
    for run in stamped[topics.EVENTS].runs:
        for message in run.messages:
            index.take(parse_events(message.data))
    last = {topic: stream.runs[-1] for topic, stream in stamped.items()}
    estimates = _readable(_since(by_topic.get(topics.ESTIMATE, []), stamped), last)
    complete = _complete_messages(last, estimates)
    trace = decode_trace(complete) if complete[topics.COMMAND] else None
    starts = {run.stamps_ns[0] for run in last.values() if run.messages}
    began = parse_command(complete[topics.COMMAND][0]).stamp_ns if trace is not None else None
    return RecordedRun(
        streams={
            topic: _statistics(topic, bag.names[topic], messages, stamped)
            for topic, messages in sorted(by_topic.items())
        },
        index=index,
        runs=max(len(stream.runs) for stream in stamped.values()),
        trace=trace,
        from_start=starts == {began} and index.first_index in (None, 0),
        wall_seconds=_wall_seconds(last),
    )


def _wall_seconds(last: Mapping[str, StampedRun]) -> float:
    commands, samples = last[topics.COMMAND], last[topics.LUMINOSITY]
    if not commands.messages:
        return 0.0
    received = dict(zip(samples.stamps_ns, samples.messages, strict=True))
    begin = received.get(commands.stamps_ns[0], commands.messages[0])
    return as_seconds(max(0, commands.messages[-1].received_ns - begin.received_ns))


def _since(
    estimates: list[RecordedMessage], stamped: Mapping[str, StampedStream]
) -> list[RecordedMessage]:
    """Estimates of the last run: those since its first message, where there were others."""
    began = [
        stream.runs[-1].messages[0].received_ns
        for stream in stamped.values()
        if len(stream.runs) > 1 and stream.runs[-1].messages
    ]
    if not began:
        return estimates
    return estimates[bisect_left(estimates, min(began), key=lambda m: m.received_ns) :]


def _readable(
    estimates: list[RecordedMessage], last: Mapping[str, StampedRun]
) -> list[RecordedMessage]:
    """Estimates with one number for every pixel of the recorded luminosity."""
    if not last[topics.LUMINOSITY].messages:
        return estimates
    pixels = parse_luminosity(last[topics.LUMINOSITY].messages[0].data).pixels.size
    return [message for message in estimates if _size_of(message.data) == pixels]


def _size_of(estimate: bytes) -> int:
    try:
        return parse_array(estimate).size
    except MessageError:
        return -1


def _statistics(
    topic: str, name: str, messages: list[RecordedMessage], stamped: Mapping[str, StampedStream]
) -> StreamStatistics:
    times = np.array([message.received_ns for message in messages], dtype=np.int64)
    pauses = as_seconds(np.diff(times))
    seconds = float(pauses.sum())
    stream = stamped.get(topic)
    missing = None
    if stream is not None and stream.runs[-1].messages:
        own = stream.runs[-1].stamps_ns
        samples = {s for other in stamped.values() for s in other.runs[-1].stamps_ns}
        missing = sum(own[0] <= s <= own[-1] for s in samples.difference(own))
    return StreamStatistics(
        topic=name,
        type_name=STREAMS[topic].type_name,
        messages=len(messages),
        rate_hz=len(pauses) / seconds if seconds else 0.0,
        longest_pause_s=float(pauses.max(initial=0.0)),
        size_bytes=sum(len(message.data) for message in messages),
        missing=missing,
        late=stream.late if stream else 0,
        repeated=stream.repeated if stream else 0,
        unreadable=stream.unreadable if stream else 0,
    )


def _complete_messages(
    run: Mapping[str, StampedRun], recorded_estimates: list[RecordedMessage]
) -> Messages:
    """Messages of the samples that every stream has, one command and estimate a sample."""
    samples = set.intersection(*(set(one.stamps_ns) for one in run.values()))
    commands = run[topics.COMMAND]
    estimates = _align(recorded_estimates, list(commands.messages))
    kept_commands, kept_estimates = [], []
    for stamp, command, estimate in zip(
        commands.stamps_ns, commands.messages, estimates, strict=True
    ):
        if stamp in samples and estimate is not None:
            kept_commands.append(command.data)
            kept_estimates.append(estimate.data)
    others = {
        topic: [m.data for m in one.messages] for topic, one in run.items()
        if topic != topics.COMMAND
    }  # fmt: skip
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
