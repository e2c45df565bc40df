"""What is known of the references now; packets, keyframes and anchors change it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.keyframe import Keyframe
from dvs_common.wire.stamp_gate import StampGate
from dvs_hinf_controller.running.intervals import ReferenceIntervals
from dvs_hinf_controller.running.packet_history import PacketHistory

# Messages that wait for the packet of their stamp.
_WAITING = 16


class Synchrony(Enum):
    """What the intervals rest on."""

    UNVERIFIED = 'no keyframe yet'
    EXACT = 'exact'
    LOST = 'events lost'
    UNKNOWN = 'references unknown'


NO_JUMPS: FloatArray = np.empty(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Taken:
    """What a packet, a keyframe or an anchor brought.

    Parameters
    ----------
    jumps
        Jump of the mean estimate at each of its events, shape (E,).
    duration_ns
        Time since the packet before, ns.
    lost
        Events that are missing before it.
    repeated
        Whether it is the last packet once more, so that nothing has changed.
    anew
        Whether a clock that has stepped makes everything begin anew.
    corrected
        Pixels that keyframes have put right; None where there was nothing to apply.
    contradicted
        Pixels that anchors have contradicted.
    """

    jumps: FloatArray
    duration_ns: int = 0
    lost: int = 0
    repeated: bool = False
    anew: bool = False
    corrected: int | None = None
    contradicted: int = 0


class _Stamped(Protocol):
    @property
    def stamp_ns(self) -> int: ...


_Message = TypeVar('_Message', bound=_Stamped)


class Waiting(Generic[_Message]):
    """Messages in the order of their stamps; where there are too many, the oldest goes."""

    def __init__(self) -> None:
        self._messages: deque[_Message] = deque()

    def add(self, message: _Message) -> None:
        """Queue a message by its stamp.

        Parameters
        ----------
        message
            The message.
        """
        ordered = sorted([*self._messages, message], key=lambda entry: entry.stamp_ns)
        self._messages = deque(ordered[-_WAITING:])

    @property
    def first(self) -> _Message | None:
        """The oldest; None where none waits."""
        return self._messages[0] if self._messages else None

    def pop(self) -> None:
        """Drop the oldest."""
        self._messages.popleft()

    def clear(self) -> None:
        """Drop all."""
        self._messages.clear()


class ReferenceState:
    """The intervals of all references, the last packets, and the messages that wait for one.

    Parameters
    ----------
    intervals
        What is known of the references where the sensor starts.
    """

    def __init__(self, intervals: ReferenceIntervals) -> None:
        self.intervals = intervals
        self.gate = StampGate()
        self.begin_anew(IndexWatch(expected=0))

    def begin_anew(self, index: IndexWatch) -> None:
        """Drop all packets and messages: they are of another time.

        Parameters
        ----------
        index
            Which running number the next event has.
        """
        self.index = index
        self.history = PacketHistory()
        self.keyframes: Waiting[Keyframe] = Waiting()
        self.anchors: Waiting[Anchor] = Waiting()
        self.verified = False
        # Before this the references or their counts had nothing to do with those of now.
        self.valid_from_ns: int | None = None

    def forget(self, stamp_ns: int) -> None:
        """Forget all bounds: another sensor sends events, whose references are not known yet.

        Parameters
        ----------
        stamp_ns
            Stamp of its first packet, ns.
        """
        self.intervals.forget()
        self.verified = False
        self.valid_from_ns = stamp_ns
        self.anchors.clear()

    @property
    def synchrony(self) -> Synchrony:
        """What the intervals rest on."""
        if self.intervals.unknown_count:
            return Synchrony.LOST if self.intervals.has_lost else Synchrony.UNKNOWN
        if self.intervals.has_lost:
            return Synchrony.LOST
        return Synchrony.EXACT if self.verified else Synchrony.UNVERIFIED

    def require_reach(self, what: str, stamp_ns: int, now_ns: int) -> None:
        """Refuse a message whose stamp is too far from the last packet's.

        Parameters
        ----------
        what
            Name of the message, for the error.
        stamp_ns
            Its stamp, ns.
        now_ns
            Stamp of the last packet, ns.

        Raises
        ------
        MessageError
            If the stamp is out of reach.
        """
        if not self.gate.follows(stamp_ns):
            raise MessageError(
                f'{what} stamped {as_seconds(stamp_ns - now_ns):+.6f} s from the last events'
            )


def sum_known(one: int | None, other: int | None) -> int | None:
    """Sum of two numbers of which either may be absent; None where both are.

    Parameters
    ----------
    one
        First number.
    other
        Second number.
    """
    return other if one is None else one + (other or 0)
