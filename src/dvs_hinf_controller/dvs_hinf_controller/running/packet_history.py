"""The last packets, for messages that come later on an instant before them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.events import INDEX_MODULUS

# An instant farther back than so many packets or events is out of reach.
_PACKETS = 1000
_EVENTS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passed:
    """What has happened to every pixel since an instant, as far as events show.

    Parameters
    ----------
    on
        ON events, shape (r,).
    off
        OFF events, shape (r,).
    unsure_on
        Those of the ON events that may have been caused before the instant, shape (r,).
    unsure_off
        Those of the OFF events that may have been, shape (r,).
    lost
        Events that never came.
    age_s
        Time since the instant, s.
    """

    on: NDArray[np.int64]
    off: NDArray[np.int64]
    unsure_on: NDArray[np.int64]
    unsure_off: NDArray[np.int64]
    lost: int
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What a packet did to the counts.

    Parameters
    ----------
    stamp_ns
        Stamp of the packet, ns.
    times_ns
        Time of every event relative to it, ns, shape (E,).
    pixels
        Row-major pixel of every event, shape (E,).
    polarities
        +1 or -1, shape (E,).
    signs
        Sign of the reference after every event, shape (E,).
    next_index
        Running number of the event after its last one; None where there is none.
    lost
        Events that are missing before this packet.
    """

    stamp_ns: int
    times_ns: NDArray[np.int32]
    pixels: NDArray[np.intp]
    polarities: NDArray[np.int8]
    signs: NDArray[np.int8]
    next_index: int | None
    lost: int

    @property
    def first_index(self) -> int | None:
        """Running number of the first event; None where there is none."""
        if self.next_index is None:
            return None
        return (self.next_index - len(self.pixels)) % INDEX_MODULUS


class PacketHistory:
    """Remembers as many packets as a bound on its memory allows."""

    def __init__(self) -> None:
        self._packets: deque[Counted] = deque()
        self._events = 0

    def add(self, packet: Counted) -> None:
        """Remember a packet that has been counted.

        Parameters
        ----------
        packet
            Later than all before it, or of the same stamp as the last.
        """
        self._packets.append(packet)
        self._events += len(packet.pixels)
        while len(self._packets) > _PACKETS or self._events > _EVENTS:
            self._events -= len(self._packets.popleft().pixels)

    def reaches(self, stamp_ns: int) -> bool:
        """Whether every packet after an instant is remembered.

        Parameters
        ----------
        stamp_ns
            Instant, ns.
        """
        return bool(self._packets) and self._packets[0].stamp_ns <= stamp_ns

    def packets_after(self, stamp_ns: int) -> list[Counted]:
        """Packets with later stamps, in order.

        Parameters
        ----------
        stamp_ns
            Instant, ns.
        """
        later = []
        for packet in reversed(self._packets):
            if packet.stamp_ns <= stamp_ns:
                break
            later.append(packet)
        return later[::-1]

    def next_index_at(self, stamp_ns: int) -> int | None:
        """Running number of the event after those up to an instant; None if unknown.

        Parameters
        ----------
        stamp_ns
            Stamp of a packet, ns.
        """
        for packet in reversed(self._packets):
            if packet.stamp_ns <= stamp_ns and packet.next_index is not None:
                return packet.next_index
        return None

    def since(self, stamp_ns: int, *, now_ns: int, latency_ns: int, pixel_count: int) -> Passed:
        """Sum up what has happened since an instant within reach.

        Parameters
        ----------
        stamp_ns
            Instant, ns.
        now_ns
            Stamp of the last packet, ns.
        latency_ns
            Longest time from what causes an event to its stamp, ns.
        pixel_count
            r.
        """
        sums = np.zeros((2, 2, pixel_count), np.int64)
        lost = 0
        for packet in self.packets_after(stamp_ns):
            lost += packet.lost
            age = packet.times_ns.astype(np.int64) + (packet.stamp_ns - stamp_ns)
            for unsure, chosen in enumerate((age > 0, (age > 0) & (age <= latency_ns))):
                for off, polarity in enumerate((1, -1)):
                    pixels = packet.pixels[chosen & (packet.polarities == polarity)]
                    sums[unsure, off] += np.bincount(pixels, minlength=pixel_count)
        (on, off_sum), (unsure_on, unsure_off) = sums
        return Passed(
            on=on,
            off=off_sum,
            unsure_on=unsure_on,
            unsure_off=unsure_off,
            lost=lost,
            age_s=as_seconds(now_ns - stamp_ns),
        )
