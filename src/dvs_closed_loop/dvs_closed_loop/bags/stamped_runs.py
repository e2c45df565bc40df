"""Runs within a recorded stream of stamped messages that may be late, repeated or unreadable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from dvs_closed_loop.bags.recorded_message import RecordedMessage
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.stamped import stamp_of

# Stamps that go back for longer than so many messages begin another run; fewer are out of order.
_REACH = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedRun:
    """Messages of one topic from one run, one a stamp.

    Parameters
    ----------
    messages
        By increasing stamp.
    stamps_ns
        Their stamps, ns.
    """

    messages: tuple[RecordedMessage, ...]
    stamps_ns: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedStream:
    """All that was recorded of one topic, in order.

    Parameters
    ----------
    runs
        At least one, which may be empty.
    late
        Messages that were recorded after one with a later stamp.
    repeated
        Messages left out since their stamp was there already.
    unreadable
        Messages left out since they break the wire contract, or differ in size from the others.
    """

    runs: tuple[StampedRun, ...]
    late: int
    repeated: int
    unreadable: int


def stamped_stream(
    messages: Sequence[RecordedMessage], shape_of: Callable[[bytes], object]
) -> StampedStream:
    """Put what was recorded of a topic in order.

    Parameters
    ----------
    messages
        In the order of their reception.
    shape_of
        What all messages of the topic have in common; raises MessageError on one that breaks the
        wire contract.
    """
    readable = _alike(messages, shape_of)
    stamps = [stamp_of(message.data) for message in readable]
    begins = [*_beginnings(stamps), len(stamps)]
    late = repeated = 0
    runs = []
    for begin, end in pairwise(begins):
        order = sorted(range(begin, end), key=stamps.__getitem__)
        kept = [
            k for k, before in zip(order, (None, *order), strict=False)
            if before is None or stamps[before] != stamps[k]
        ]  # fmt: skip
        repeated += end - begin - len(kept)
        highest = None
        for k in sorted(kept):
            late += highest is not None and stamps[k] < highest
            highest = stamps[k] if highest is None else max(highest, stamps[k])
        runs.append(
            StampedRun(
                messages=tuple(readable[k] for k in kept),
                stamps_ns=tuple(stamps[k] for k in kept),
            )
        )
    return StampedStream(
        runs=tuple(runs),
        late=late,
        repeated=repeated,
        unreadable=len(messages) - len(readable),
    )


def _alike(
    messages: Sequence[RecordedMessage], shape_of: Callable[[bytes], object]
) -> list[RecordedMessage]:
    """Readable messages of the shape that most of them have."""
    shapes: list[object] = []
    for message in messages:
        try:
            shapes.append(shape_of(message.data))
        except MessageError:
            shapes.append(None)
    counts = Counter(shape for shape in shapes if shape is not None)
    if not counts:
        return []
    usual = counts.most_common(1)[0][0]
    return [message for message, shape in zip(messages, shapes, strict=True) if shape == usual]


def _beginnings(stamps: Sequence[int]) -> list[int]:
    """Positions at which runs begin.

    A run begins where the stamps go back and stay back, or go once more through what was there
    from the very beginning.
    """
    begins = [0]
    seen: set[int] = set()
    highest = None
    k = 0
    while k < len(stamps):
        if highest is None or stamps[k] >= highest:
            highest = stamps[k]
            seen.add(highest)
            k += 1
            continue
        end = k
        while end < len(stamps) and stamps[end] < highest and end - k <= _REACH:
            end += 1
        back = stamps[k:end]
        over_again = len(back) > 1 and back[0] <= min(seen) and seen.issuperset(back)
        if len(back) > _REACH or over_again:
            begins.append(k)
            seen = set()
            highest = None
        else:
            seen.update(back)
            k = end
    return begins
