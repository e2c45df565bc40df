"""What a bag holds of a run, also where the recording began late, lost or mixed something."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dvs_closed_loop.bags.bag import RecordedBag
from dvs_closed_loop.bags.recorded_message import RecordedMessage
from dvs_closed_loop.bags.stamped_runs import StampedRun, StampedStream, stamped_stream
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire import topics
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.messages import parse_command, parse_state
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_simulation.judging.trace import Messages, Trace, decode_trace

# Streams that have one message for every sample, stamped with its time.
STAMPED: Mapping[str, Callable[[bytes], object]] = {
    topics.LUMINOSITY: lambda message: parse_luminosity(message).pixels.shape,
    topics.EVENTS: lambda message: parse_events(message).events.dtype,
    topics.COMMAND: lambda message: parse_command(message).values.size,
    topics.STATE: lambda message: parse_state(message).values.size,
    topics.ESTIMATE: lambda message: parse_state(message).values.size,
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
        reasons = (
            (self.unreadable, 'left out: against the wire contract, or of another size'),
            (self.late, 'put in order: recorded out of order'),
            (self.repeated, 'left out: the same stamp came before'),
        )
        lines = [
            f'{self.topic}: {count} of {self.messages} messages {what}'
            for count, what in reasons
            if count
        ]
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
    unrecorded
        Samples within `trace` that some topic has and another lacks: lost by the recorder.
    without_states
        Messages of the samples that every topic but an empty `state` has; empty otherwise.
    """

    streams: dict[str, StreamStatistics]
    index: IndexWatch
    runs: int
    trace: Trace | None
    from_start: bool
    wall_seconds: float
    unrecorded: int = 0
    without_states: Messages = field(default_factory=dict)

    @property
    def troubles(self) -> list[str]:
        """What was read around, one line each, and how much of the bag was left out."""
        lines = [line for stream in self.streams.values() for line in stream.troubles]
        if self.runs > 1:
            lines.append(f'the bag holds {self.runs} runs; this is the last one')
        if self.index.lost:
            # Packets that are not in the bag although the run had their samples.
            gone = self.streams[topics.EVENTS].missing if topics.EVENTS in self.streams else 0
            whose = f', {gone} packets of which the recorder lost' if gone else ''
            lines.append(f'{self.index.lost} events are missing in {self.index.gaps} gaps{whose}')
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
    complete = _complete_messages(last)
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
        unrecorded=_unrecorded(last, complete),
        without_states=_without_states(last),
    )


def _without_states(last: Mapping[str, StampedRun]) -> Messages:
    if last[topics.STATE].messages:
        return {}
    return _complete_messages({topic: run for topic, run in last.items() if topic != topics.STATE})


def _unrecorded(last: Mapping[str, StampedRun], complete: Messages) -> int:
    """Samples between the first and the last complete one that only some topics have."""
    whole = {parse_command(message).stamp_ns for message in complete[topics.COMMAND]}
    if not whole:
        return 0
    some = {stamp for run in last.values() for stamp in run.stamps_ns}
    return sum(min(whole) < stamp < max(whole) for stamp in some - whole)


def _wall_seconds(last: Mapping[str, StampedRun]) -> float:
    commands, samples = last[topics.COMMAND], last[topics.LUMINOSITY]
    if not commands.messages:
        return 0.0
    received = dict(zip(samples.stamps_ns, samples.messages, strict=True))
    begin = received.get(commands.stamps_ns[0], commands.messages[0])
    return as_seconds(max(0, commands.messages[-1].received_ns - begin.received_ns))


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


def _complete_messages(run: Mapping[str, StampedRun]) -> Messages:
    """Messages of the samples that every stream has."""
    samples = set.intersection(*(set(one.stamps_ns) for one in run.values()))
    return {
        topic: [
            message.data
            for stamp, message in zip(one.stamps_ns, one.messages, strict=True)
            if stamp in samples
        ]
        for topic, one in run.items()
    }
