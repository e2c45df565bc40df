"""The references, followed from packet to packet; keyframes and anchors apply in between."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.events import INDEX_MODULUS, EventPacket
from dvs_common.wire.index_watch import IndexStep, IndexWatch, Order
from dvs_common.wire.keyframe import Keyframe
from dvs_common.wire.stamp_gate import Passage, StampGate
from dvs_hinf_controller.running.anchors import Anchors
from dvs_hinf_controller.running.interval_arithmetic import LARGEST_LOGARITHM, require_finite
from dvs_hinf_controller.running.intervals import ReferenceIntervals
from dvs_hinf_controller.running.keyframes import Keyframes
from dvs_hinf_controller.running.packet_history import Counted
from dvs_hinf_controller.running.pixel_health import PixelHealth
from dvs_hinf_controller.running.reference_state import (
    NO_JUMPS,
    ReferenceState,
    Synchrony,
    Taken,
    sum_known,
)
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty

_NO_PIXELS = np.empty(0, np.intp)
_NO_SIGNS = np.empty(0, np.int8)
_NO_TIMES = np.empty(0, np.int32)


class ReferenceWatch:
    """Keeps the intervals of all references true to all messages so far.

    Parameters
    ----------
    bounds
        What is known of q where the sensor starts, unless its keyframe is more exact.
    event_threshold
        h of the first events.
    log_base
        b.
    width
        Columns of the pixel array.
    uncertainty
        How far the sensor may be from an ideal one.
    masked
        Pixels that are not to be used.
    """

    def __init__(
        self,
        bounds: ReferenceBounds,
        *,
        event_threshold: float,
        log_base: float,
        width: int,
        uncertainty: SensorUncertainty,
        masked: Sequence[int] = (),
    ) -> None:
        self._width = width
        self.health = PixelHealth(bounds.lower.size, masked)
        self.intervals = ReferenceIntervals(
            bounds, event_threshold=event_threshold, log_base=log_base, uncertainty=uncertainty
        )
        self.intervals.restrict_to(self.health.healthy)
        self._state = ReferenceState(self.intervals)
        self._keyframes = Keyframes(self._state)
        self.anchors = Anchors(
            self._state, self.health, latency_ns=as_nanoseconds(uncertainty.latency)
        )

    @property
    def gate(self) -> StampGate:
        """Which stamps follow those before."""
        return self._state.gate

    @property
    def synchrony(self) -> Synchrony:
        """What the intervals rest on."""
        return self._state.synchrony

    @property
    def needs_keyframe(self) -> bool:
        """Whether a keyframe would bring something that is not known."""
        return not self._state.verified or self.synchrony is not Synchrony.EXACT

    def duration_of_silence_ns(self, packet: EventPacket) -> int | None:
        """Time since the last packet, where a next one brings nothing but that it has passed.

        None where it has events or other messages wait for it, where references leak, and where
        its stamp does not follow.

        Parameters
        ----------
        packet
            Next packet.
        """
        state, last_ns = self._state, self.gate.last_ns
        if len(packet.events) or last_ns is None or self.intervals.step_bounds.uncertainty.leak:
            return None
        if state.keyframes.first is not None or state.anchors.first is not None:
            return None
        duration_ns = packet.stamp_ns - last_ns
        return duration_ns if duration_ns > 0 and self.gate.follows(packet.stamp_ns) else None

    def pass_silence(self, stamp_ns: int) -> None:
        """Take a packet of which `duration_of_silence_ns` found that it brings nothing.

        Parameters
        ----------
        stamp_ns
            Stamp of the packet, ns.
        """
        self.gate.take(stamp_ns)
        self._remember(stamp_ns, lost=0)

    def take_keyframe(self, keyframe: Keyframe) -> Taken:
        """Take the sensor's own state; see `Keyframes.take`.

        Parameters
        ----------
        keyframe
            State of the sensor.
        """
        return self._keyframes.take(keyframe)

    def take_anchor(self, anchor: Anchor) -> Taken:
        """Take an absolute measurement; see `Anchors.take`.

        Parameters
        ----------
        anchor
            What was measured.
        """
        return self.anchors.take(anchor)

    def take(self, packet: EventPacket) -> Taken:
        """Take a packet whose events are in order and within the array.

        Parameters
        ----------
        packet
            Next packet.

        Raises
        ------
        MessageError
            If its stamp is an outlier or its events lead out of the range of numbers; nothing has
            changed then but the count of outliers.
        """
        state, events, last_ns = self._state, packet.events, self.gate.last_ns
        pixels = events['y'].astype(np.intp) * self._width + events['x']
        index = copy(state.index)
        step = index.follow(packet.stamp_ns, events['index']) if len(events) else None
        if self.gate.follows(packet.stamp_ns) and len(events):
            self._require_countable(pixels, events['polarity'])
        passage = self.gate.take(packet.stamp_ns)
        if passage is Passage.REFUSED:
            assert last_ns is not None
            state.require_reach('events', packet.stamp_ns, last_ns)
        if passage is Passage.STEPPED:
            return self._step(packet)
        if passage is Passage.REPEATED and self._is_repeated(step):
            return Taken(jumps=NO_JUMPS, repeated=True)
        if passage is Passage.FIRST and self._missed_the_start(packet.stamp_ns):
            state.forget(packet.stamp_ns)
        duration_ns = 0 if last_ns is None else packet.stamp_ns - last_ns
        corrected = self._keyframes.apply_due(last_ns, is_over=True)
        self.intervals.leak(as_seconds(duration_ns))
        lost = self._heed(step, packet.stamp_ns)
        state.index = index
        jumps = self._count(packet, pixels, lost)
        corrected = sum_known(corrected, self._keyframes.apply_due(packet.stamp_ns))
        return Taken(
            jumps=jumps,
            duration_ns=duration_ns,
            lost=lost,
            corrected=corrected,
            contradicted=self.anchors.apply_due(),
        )

    def _missed_the_start(self, stamp_ns: int) -> bool:
        """Whether packets are missing between the first keyframe and the first packet."""
        first = self._state.keyframes.first
        return first is not None and first.stamp_ns != stamp_ns

    def _is_repeated(self, step: IndexStep | None) -> bool:
        return step is None or step.order in (Order.REPEATED, Order.GONE_BACK)

    def _require_countable(self, pixels: NDArray[np.intp], polarities: NDArray[np.int8]) -> None:
        """Refuse a packet that could lead out of the range of numbers, before anything changes."""
        known = self.intervals
        if (known.farthest_count + len(pixels)) * known.log_step < LARGEST_LOGARITHM:
            return
        moved, moves = np.unique(pixels, return_counts=True)
        require_finite(np.asarray((np.abs(known.counts[moved]) + moves) * known.log_step))

    def _heed(self, step: IndexStep | None, stamp_ns: int) -> int:
        """Widen for the gaps of the running numbers; return how many events are missing."""
        if step is None:
            return 0
        if step.order is Order.GONE_BACK:
            self._state.forget(stamp_ns)
        if step.lost:
            self.intervals.lose(step.lost)
        return step.lost

    def _count(self, packet: EventPacket, pixels: NDArray[np.intp], lost: int) -> FloatArray:
        events = packet.events
        if not len(events):
            self._remember(packet.stamp_ns, lost=0)
            return NO_JUMPS
        polarities, signs = events['polarity'], events['sign']
        jumps = self.intervals.apply(pixels, polarities, signs)
        self._state.history.add(
            Counted(
                stamp_ns=packet.stamp_ns,
                times_ns=events['t'],
                pixels=pixels,
                polarities=polarities,
                signs=signs,
                next_index=(int(events['index'][-1]) + 1) % INDEX_MODULUS,
                lost=lost,
            )
        )
        return jumps

    def _remember(self, stamp_ns: int, *, lost: int) -> None:
        self._state.history.add(
            Counted(
                stamp_ns=stamp_ns,
                times_ns=_NO_TIMES,
                pixels=_NO_PIXELS,
                polarities=_NO_SIGNS,
                signs=_NO_SIGNS,
                next_index=None,
                lost=lost,
            )
        )

    def _step(self, packet: EventPacket) -> Taken:
        """Begin anew where the clock has stepped: what became of the sensor is not known."""
        self._state.begin_anew(IndexWatch())
        self._state.forget(packet.stamp_ns)
        self._remember(packet.stamp_ns, lost=0)
        return Taken(jumps=NO_JUMPS, anew=True)
