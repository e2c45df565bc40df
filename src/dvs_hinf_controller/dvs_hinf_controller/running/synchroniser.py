"""Does the estimator know every event? If not, a keyframe of the sensor puts it right, exactly."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.index_watch import IndexStep, IndexWatch, Order
from dvs_common.wire.keyframe import Keyframe

# Packets that are kept while a keyframe is awaited; an older keyframe than these is of no use.
_MEMORY = 1000


_NO_PIXELS = np.empty(0, np.intp)
_NO_SIGNS = np.empty(0, np.int8)


class Synchrony(Enum):
    """How far the estimator's counts can be trusted."""

    UNVERIFIED = 'no keyframe yet'
    EXACT = 'exact'
    LOST = 'events lost'
    # Its references are others now, and no keyframe tells where they are.
    RESTARTED = 'sensor started again'


# What needs no memory of packets: nothing is to be put right, or nothing can be.
_AT_REST = (Synchrony.EXACT, Synchrony.RESTARTED)


@dataclass(frozen=True, slots=True)
class _Counted:
    """What a packet did to the counts."""

    stamp_ns: int
    pixels: NDArray[np.intp]
    polarities: NDArray[np.int8]
    signs: NDArray[np.int8]


class Synchroniser:
    """Watches the running event number and fits keyframes to the packets around them."""

    def __init__(self) -> None:
        self.state = Synchrony.UNVERIFIED
        self._index = IndexWatch(expected=0)
        self._recent: deque[_Counted] = deque(maxlen=_MEMORY)
        self._pending: Keyframe | None = None

    def note(
        self,
        stamp_ns: int,
        indices: NDArray[np.uint32],
        pixels: NDArray[np.intp],
        polarities: NDArray[np.int8],
        signs: NDArray[np.int8],
    ) -> IndexStep:
        """Remember a packet of events; return how its running numbers follow the last ones.

        Parameters
        ----------
        stamp_ns
            Stamp of the packet, ns.
        indices
            Running event numbers, shape (E,).
        pixels
            Row-major pixel numbers, shape (E,).
        polarities
            +1 or -1, shape (E,).
        signs
            Signs of the references, shape (E,).
        """
        step = self._index.follow(stamp_ns, indices)
        if step.order is Order.GONE_BACK:
            self.distrust()
            return step
        if step.order is Order.LOST and self.state is not Synchrony.RESTARTED:
            self.state = Synchrony.LOST
            self._recent.clear()
        if step.order is not Order.REPEATED and self.state not in _AT_REST:
            self._recent.append(_Counted(stamp_ns, pixels, polarities, signs))
        return step

    def note_silence(self, stamp_ns: int) -> None:
        """Remember a packet without events.

        Parameters
        ----------
        stamp_ns
            Stamp of the packet, ns.
        """
        if self.state not in _AT_REST:
            self._recent.append(_Counted(stamp_ns, _NO_PIXELS, _NO_SIGNS, _NO_SIGNS))

    def accept_any_index(self) -> None:
        """Take the next index as it comes: a sensor that starts again may go on counting."""
        self._index = IndexWatch()

    def start_epoch(self) -> None:
        """Forget packets and keyframes: the sensor counts from zero again, and shall verify it."""
        self._recent.clear()
        self._pending = None
        if self.state is Synchrony.EXACT:
            self.state = Synchrony.UNVERIFIED

    def give_up(self) -> None:
        """Trust no count before the next keyframe."""
        self._recent.clear()
        self._pending = None
        if self.state is not Synchrony.RESTARTED:
            self.state = Synchrony.LOST

    def distrust(self) -> None:
        """Trust nothing any more: the sensor has started again while the estimator went on."""
        self._recent.clear()
        self._pending = None
        self.state = Synchrony.RESTARTED

    def offer(self, keyframe: Keyframe) -> None:
        """Take a keyframe, of the past or of a packet still to come.

        Parameters
        ----------
        keyframe
            State of the sensor.
        """
        self._pending = keyframe

    def resolve(self, stamp_ns: int) -> Keyframe | None:
        """Counts that must hold at `stamp_ns`, if the last keyframe tells them.

        Parameters
        ----------
        stamp_ns
            Stamp of the last packet taken, ns.
        """
        keyframe = self._pending
        if keyframe is None or keyframe.stamp_ns > stamp_ns:
            return None
        if self.state is Synchrony.RESTARTED:
            return None
        self._pending = None
        if keyframe.stamp_ns < stamp_ns:
            if not self._recent or keyframe.stamp_ns < self._recent[0].stamp_ns:
                return None
            keyframe = self._carried_on(keyframe, stamp_ns)
        self.state = Synchrony.EXACT
        self._recent.clear()
        return keyframe

    def _carried_on(self, keyframe: Keyframe, stamp_ns: int) -> Keyframe:
        counts, signs = keyframe.counts.copy(), keyframe.signs.copy()
        for packet in self._recent:
            if packet.stamp_ns > keyframe.stamp_ns:
                np.add.at(counts, packet.pixels, packet.polarities)
                signs[packet.pixels] = packet.signs
        return replace(keyframe, stamp_ns=stamp_ns, counts=counts, signs=signs)
