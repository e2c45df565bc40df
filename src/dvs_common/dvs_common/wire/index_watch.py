"""The running event number that every event carries: in order, lost, repeated or gone back."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.events import INDEX_MODULUS, EventPacket


class Order(Enum):
    """How a packet follows the one before it."""

    IN_ORDER = 'in order'
    LOST = 'events lost'
    REPEATED = 'packet received twice'
    GONE_BACK = 'sensor started again'


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexStep:
    """What the running event numbers of one packet show.

    Parameters
    ----------
    order
        How the packet follows the one before it.
    lost
        Events missing before the last event of the packet; positive for `Order.LOST` only.
    """

    order: Order
    lost: int = 0


_IN_ORDER = IndexStep(order=Order.IN_ORDER)
_REPEATED = IndexStep(order=Order.REPEATED)
_GONE_BACK = IndexStep(order=Order.GONE_BACK)


class IndexWatch:
    """Follows the running event number through the packets of one camera.

    A number that is less than half its range ahead of the expected one is a loss. Any other has
    gone back, which no loss does: the camera has started again. So it has where a stamp goes
    back. A packet with the stamp and the numbers of the last one is that packet once more.

    Parameters
    ----------
    expected
        Number of the first event, or None if any will do.
    """

    def __init__(self, *, expected: int | None = None) -> None:
        self.events = 0
        self.on_events = 0
        self.lost = 0
        self.gaps = 0
        self.repeated = 0
        self.restarts = 0
        self.first_index: int | None = None
        self._next = expected
        self._stamp_ns: int | None = None
        self._last: tuple[int, int, int] | None = None

    def take(self, packet: EventPacket) -> IndexStep:
        """Count the events of a packet, and what is missing before them.

        Parameters
        ----------
        packet
            Next packet.
        """
        events = packet.events
        step = self.follow(packet.stamp_ns, events['index'])
        if step is not _REPEATED and len(events):
            self.events += len(events)
            self.on_events += int(np.count_nonzero(events['polarity'] > 0))
        return step

    def follow(self, stamp_ns: int, indices: NDArray[np.uint32]) -> IndexStep:
        """Compare the numbers of a packet with those before it.

        Parameters
        ----------
        stamp_ns
            Stamp of the packet, ns.
        indices
            Running event numbers, shape (E,).
        """
        went_back = self._stamp_ns is not None and stamp_ns < self._stamp_ns
        self._stamp_ns = stamp_ns
        if went_back:
            self._next = self._last = None
        step = self._order(stamp_ns, indices) if len(indices) else _IN_ORDER
        if went_back:
            step = _GONE_BACK
        self.lost += step.lost
        self.gaps += step.order is Order.LOST
        self.repeated += step is _REPEATED
        self.restarts += step is _GONE_BACK
        return step

    def _order(self, stamp_ns: int, indices: NDArray[np.uint32]) -> IndexStep:
        first, last = int(indices[0]), int(indices[-1])
        packet = (stamp_ns, first, last)
        if packet == self._last:
            return _REPEATED
        if self.first_index is None:
            self.first_index = first
        expected = first if self._next is None else self._next
        self._next, self._last = (last + 1) % INDEX_MODULUS, packet
        before = (first - expected) % INDEX_MODULUS
        within = (last - first + 1 - len(indices)) % INDEX_MODULUS
        if max(before, within) >= INDEX_MODULUS // 2:
            return _GONE_BACK
        lost = before + within
        return IndexStep(order=Order.LOST, lost=lost) if lost else _IN_ORDER
