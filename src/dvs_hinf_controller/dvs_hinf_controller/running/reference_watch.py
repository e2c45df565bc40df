"""Everything that tells of the references, put together: packets, keyframes and anchors."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import INDEX_MODULUS, EventPacket
from dvs_common.wire.index_watch import IndexStep, IndexWatch, Order
from dvs_common.wire.keyframe import Keyframe
from dvs_common.wire.stamp_gate import Passage, StampGate
from dvs_hinf_controller.running.interval_arithmetic import LARGEST_LOGARITHM, Told, require_finite
from dvs_hinf_controller.running.intervals import ReferenceIntervals
from dvs_hinf_controller.running.packet_history import Counted, PacketHistory
from dvs_hinf_controller.running.pixel_health import PixelHealth
from dvs_hinf_controller.running.sensor_uncertainty import SensorUncertainty

# Keyframes and anchors that wait for the packet of their stamp.
_WAITING = 16
# Packets of a sensor that may arrive before the keyframe of its start does.
_AHEAD_OF_KEYFRAME = 20
# Epochs before this one, and how often one of them must speak before it is believed again.
_PAST_EPOCHS = 64
_INSISTS = 3
_NO_PIXELS = np.empty(0, np.intp)
_NO_SIGNS = np.empty(0, np.int8)
_NO_TIMES = np.empty(0, np.int32)


class Synchrony(Enum):
    """What the intervals rest on."""

    UNVERIFIED = 'no keyframe yet'
    EXACT = 'exact'
    LOST = 'events lost'
    UNKNOWN = 'references unknown'


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Taken:
    """What a packet brought.

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


_NO_JUMPS: FloatArray = np.empty(0)


class ReferenceWatch:
    """Keeps the intervals of all references true to what has been told of them so far.

    Parameters
    ----------
    bounds
        What is known of q where the sensor starts, unless its keyframe says better.
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
        self._uncertainty = uncertainty
        self._latency_ns = as_nanoseconds(uncertainty.latency)
        self.health = PixelHealth(bounds.lower.size, masked)
        self.intervals = ReferenceIntervals(
            bounds, event_threshold=event_threshold, log_base=log_base, uncertainty=uncertainty
        )
        self.intervals.listen_to(self.health.healthy)
        self.epoch: int | None = None
        self._past_epochs: deque[int] = deque(maxlen=_PAST_EPOCHS)
        self._insisted = 0
        self.contradictions = self.anchors = self.anchors_unused = 0
        self.gate = StampGate()
        self._begin_anew(IndexWatch(expected=0))

    def _begin_anew(self, index: IndexWatch) -> None:
        self._index = index
        self._history = PacketHistory()
        self._keyframes: deque[Keyframe] = deque()
        self._anchors: deque[Anchor] = deque()
        self._verified = False
        # Before this the references or their counts had nothing to do with those of now.
        self._valid_from_ns: int | None = None

    @property
    def synchrony(self) -> Synchrony:
        """What the intervals rest on."""
        if self.intervals.unknown_count:
            return Synchrony.LOST if self.intervals.has_lost else Synchrony.UNKNOWN
        if self.intervals.has_lost:
            return Synchrony.LOST
        return Synchrony.EXACT if self._verified else Synchrony.UNVERIFIED

    @property
    def needs_keyframe(self) -> bool:
        """Whether a keyframe would tell something that is not known."""
        return not self._verified or self.synchrony is not Synchrony.EXACT

    # -- packets ----------------------------------------------------------------------------------

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
        events, last_ns = packet.events, self.gate.last_ns
        pixels = events['y'].astype(np.intp) * self._width + events['x']
        index = copy(self._index)
        step = index.follow(packet.stamp_ns, events['index']) if len(events) else None
        follows = self.gate.follows(packet.stamp_ns)
        if follows and len(events):
            self._require_countable(pixels, events['polarity'])
        passage = self.gate.take(packet.stamp_ns)
        if passage is Passage.REFUSED:
            assert last_ns is not None
            self._require_reach('events', packet.stamp_ns, last_ns)
        if passage is Passage.STEPPED:
            return self._step(packet)
        if passage is Passage.REPEATED and self._is_repeated(step):
            return Taken(jumps=_NO_JUMPS, repeated=True)
        if passage is Passage.FIRST and self._missed_the_start(packet.stamp_ns):
            self._forget(packet.stamp_ns)
        duration_ns = 0 if last_ns is None else packet.stamp_ns - last_ns
        corrected = self._apply_keyframes(last_ns, is_over=True)
        self.intervals.leak(as_seconds(duration_ns))
        lost = self._heed(step, packet.stamp_ns)
        self._index = index
        jumps = self._count(packet, pixels, lost)
        corrected = _sum(corrected, self._apply_keyframes(packet.stamp_ns))
        return Taken(
            jumps=jumps,
            duration_ns=duration_ns,
            lost=lost,
            corrected=corrected,
            contradicted=self._apply_anchors(),
        )

    def _missed_the_start(self, stamp_ns: int) -> bool:
        """Whether packets are missing between the first keyframe and the first packet."""
        return bool(self._keyframes) and self._keyframes[0].stamp_ns != stamp_ns

    def _is_repeated(self, step: IndexStep | None) -> bool:
        return step is None or step.order in (Order.REPEATED, Order.GONE_BACK)

    def _require_countable(self, pixels: NDArray[np.intp], polarities: NDArray[np.int8]) -> None:
        """Refuse a packet that could lead out of the range of numbers, before anything changes."""
        known = self.intervals
        if (np.abs(known.counts).max() + len(pixels)) * known.log_step < LARGEST_LOGARITHM:
            return
        moves = np.bincount(pixels, minlength=known.counts.size)
        require_finite(np.asarray((np.abs(known.counts) + moves) * known.log_step))

    def _heed(self, step: IndexStep | None, stamp_ns: int) -> int:
        """Widen for what the running numbers tell; return how many events are missing."""
        if step is None:
            return 0
        if step.order is Order.GONE_BACK:
            self._forget(stamp_ns)
        if step.lost:
            self.intervals.lose(step.lost)
        return step.lost

    def _forget(self, stamp_ns: int) -> None:
        """Know nothing: another sensor speaks, and has not said yet where its references are."""
        self.intervals.forget()
        self._verified = False
        self._valid_from_ns = stamp_ns
        self._anchors.clear()

    def _count(self, packet: EventPacket, pixels: NDArray[np.intp], lost: int) -> FloatArray:
        events = packet.events
        if not len(events):
            self._remember(packet.stamp_ns, lost=0)
            return _NO_JUMPS
        polarities, signs = events['polarity'], events['sign']
        jumps = self.intervals.apply(pixels, polarities, signs)
        self._history.add(
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
        self._history.add(
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
        self._begin_anew(IndexWatch())
        self._forget(packet.stamp_ns)
        self._remember(packet.stamp_ns, lost=0)
        return Taken(jumps=_NO_JUMPS, anew=True)

    # -- keyframes --------------------------------------------------------------------------------

    def take_keyframe(self, keyframe: Keyframe) -> Taken:
        """Take what the sensor tells of itself; one of a packet still to come waits for it.

        Parameters
        ----------
        keyframe
            State of the sensor.

        Raises
        ------
        MessageError
            If it is of another array, or its stamp or numbers are out of range; nothing has
            changed then.
        """
        known, now_ns = self.intervals, self.gate.last_ns
        if keyframe.counts.size != known.counts.size:
            raise MessageError(
                f'keyframe of {keyframe.counts.size} pixels, the array has {known.counts.size}'
            )
        step = known.log_step * keyframe.event_threshold / known.event_threshold
        upper = np.where(np.isfinite(keyframe.upper), keyframe.upper, 1.0)
        require_finite(np.abs(keyframe.counts) * step + np.abs(np.log(upper)))
        if now_ns is None:
            return self._start(keyframe)
        if keyframe.epoch != self.epoch:
            self._require_current(keyframe)
            return self._change_epoch(keyframe, now_ns)
        self._insisted = 0
        if keyframe.stamp_ns > now_ns:
            self._require_reach('keyframe', keyframe.stamp_ns, now_ns)
        return self._await(keyframe)

    def _require_reach(self, what: str, stamp_ns: int, now_ns: int) -> None:
        if not self.gate.follows(stamp_ns):
            raise MessageError(
                f'{what} stamped {as_seconds(stamp_ns - now_ns):+.6f} s from the last events'
            )

    def _await(self, keyframe: Keyframe) -> Taken:
        _insert(self._keyframes, keyframe)
        return Taken(jumps=_NO_JUMPS, corrected=self._apply_keyframes(self.gate.last_ns))

    def _require_current(self, keyframe: Keyframe) -> None:
        """Refuse a keyframe of an epoch that is over, unless nothing else arrives any more."""
        if keyframe.epoch not in self._past_epochs or not self._verified:
            return
        self._insisted += 1
        if self._insisted < _INSISTS:
            raise MessageError(f'keyframe of the epoch {keyframe.epoch}, which is over')

    def _start(self, keyframe: Keyframe) -> Taken:
        """Begin with a keyframe, before any packet."""
        self._enter(keyframe.epoch)
        corrected = self.intervals.restart(_told(keyframe))
        self._index = IndexWatch(expected=keyframe.next_index)
        self._keyframes = deque([keyframe])
        return Taken(jumps=_NO_JUMPS, corrected=corrected)

    def _enter(self, epoch: int) -> None:
        if self.epoch is not None and self.epoch != epoch:
            self._past_epochs.append(self.epoch)
        self.epoch, self._insisted = epoch, 0

    def _change_epoch(self, keyframe: Keyframe, now_ns: int) -> Taken:
        """Another sensor, or the same one started again."""
        if self.epoch is None and not self._history.reaches(keyframe.stamp_ns):
            # We came into the midst of its epoch, and the next keyframe will tell.
            self.epoch = keyframe.epoch
            self._forget(now_ns)
            return Taken(jumps=_NO_JUMPS)
        if self.epoch is None or self._is_of_these_times(keyframe, now_ns):
            return self._await(keyframe)
        self.gate.restart(None)
        self._begin_anew(IndexWatch())
        corrected = self._start(keyframe).corrected
        return Taken(jumps=_NO_JUMPS, anew=True, corrected=corrected)

    def _is_of_these_times(self, keyframe: Keyframe, now_ns: int) -> bool:
        """Whether the sensor has started again while time went on, and not with a new time."""
        if keyframe.stamp_ns > now_ns:
            return self.gate.follows(keyframe.stamp_ns)
        later = self._history.packets_after(keyframe.stamp_ns)
        if not self._history.reaches(keyframe.stamp_ns) or len(later) > _AHEAD_OF_KEYFRAME:
            return False
        first = next((p.first_index for p in later if p.first_index is not None), None)
        return first is None or first == keyframe.next_index

    def _apply_keyframes(self, now_ns: int | None, *, is_over: bool = False) -> int | None:
        """Apply the keyframes whose packet is there, in order; return the pixels put right.

        One that changes the threshold waits until the sample of its stamp is over: only then has
        every pixel been compared with the new one.
        """
        corrected = None
        while self._keyframes and now_ns is not None:
            keyframe = self._keyframes[0]
            is_due = keyframe.stamp_ns <= now_ns
            waits = keyframe.stamp_ns == now_ns and not is_over and self._changes_step(keyframe)
            if not is_due or waits:
                break
            self._keyframes.popleft()
            if self._history.reaches(keyframe.stamp_ns):
                corrected = _sum(corrected, self._apply(keyframe, now_ns))
        return corrected

    def _changes_step(self, keyframe: Keyframe) -> bool:
        is_other = keyframe.event_threshold != self.intervals.event_threshold
        return is_other and keyframe.epoch == self.epoch

    def _apply(self, keyframe: Keyframe, now_ns: int) -> int:
        known = self.intervals
        same_epoch = keyframe.epoch == self.epoch
        later = self._history.packets_after(keyframe.stamp_ns)
        told = _told(keyframe, age_ns=now_ns - keyframe.stamp_ns)
        for packet in later:
            np.add.at(told.counts, packet.pixels, packet.polarities)
            told.signs[packet.pixels] = packet.signs
        if not same_epoch:
            self._enter(keyframe.epoch)
            self._valid_from_ns = keyframe.stamp_ns
            self._expect(keyframe, later)
            corrected = known.restart(told) or 0
        elif self._changes_step(keyframe):
            self._valid_from_ns = keyframe.stamp_ns
            if not any(len(packet.pixels) for packet in later):
                known.change_threshold(keyframe.event_threshold)
            corrected = known.restart(told) or 0
        else:
            unheard = self._unheard(keyframe)
            if unheard:
                known.lose(unheard)
                self._expect(keyframe, later)
            corrected = known.confirm(told)
        self._verified = True
        return corrected

    def _expect(self, keyframe: Keyframe, later: list[Counted]) -> None:
        numbers = [packet.next_index for packet in later if packet.next_index is not None]
        self._index = IndexWatch(expected=numbers[-1] if numbers else keyframe.next_index)

    def _unheard(self, keyframe: Keyframe) -> int:
        """Events before a keyframe's stamp that no packet has brought and no gap has shown."""
        expected = self._history.next_index_at(keyframe.stamp_ns)
        if expected is None:
            return 0
        missing = (keyframe.next_index - expected) % INDEX_MODULUS
        return missing if missing < INDEX_MODULUS // 2 else 0

    # -- anchors ----------------------------------------------------------------------------------

    def take_anchor(self, anchor: Anchor) -> Taken:
        """Take an absolute measurement; one of a packet still to come waits for it.

        Parameters
        ----------
        anchor
            What was measured.

        Raises
        ------
        MessageError
            If it is of another array, or its stamp is out of reach.
        """
        if anchor.luminosity.size != self.intervals.counts.size:
            raise MessageError(
                f'anchor of {anchor.luminosity.size} pixels, the array has '
                f'{self.intervals.counts.size}'
            )
        now_ns = self.gate.last_ns
        if now_ns is not None and anchor.stamp_ns > now_ns:
            self._require_reach('anchor', anchor.stamp_ns, now_ns)
        _insert(self._anchors, anchor)
        return Taken(jumps=_NO_JUMPS, contradicted=self._apply_anchors())

    def _apply_anchors(self) -> int:
        """Cut by the anchors whose events are all there; return the pixels contradicted."""
        contradicted = 0
        now_ns = self.gate.last_ns
        while self._anchors and now_ns is not None:
            anchor = self._anchors[0]
            if anchor.stamp_ns + self._latency_ns > now_ns:
                break
            self._anchors.popleft()
            if self._is_usable(anchor):
                contradicted += self._cut(anchor, now_ns)
            else:
                self.anchors_unused += 1
        return contradicted

    def _is_usable(self, anchor: Anchor) -> bool:
        is_later = self._valid_from_ns is None or anchor.stamp_ns >= self._valid_from_ns
        return is_later and self._history.reaches(anchor.stamp_ns)

    def _cut(self, anchor: Anchor, now_ns: int) -> int:
        passed = self._history.since(
            anchor.stamp_ns,
            now_ns=now_ns,
            latency_ns=self._latency_ns,
            pixel_count=anchor.luminosity.size,
        )
        cut = self.intervals.cut(anchor.luminosity, passed)
        self.anchors += 1
        if self.health.note(cut.confirmed, cut.contradicted):
            self.intervals.listen_to(self.health.healthy)
        number = int(np.count_nonzero(cut.contradicted))
        self.contradictions += number
        return number


def _sum(one: int | None, other: int | None) -> int | None:
    return other if one is None else one + (other or 0)


def _insert(waiting: deque[Any], message: Any) -> None:
    """Queue a message by its stamp; the oldest goes where there are too many."""
    waiting.append(message)
    ordered = sorted(waiting, key=lambda entry: entry.stamp_ns)
    waiting.clear()
    waiting.extend(ordered[-_WAITING:])


def _told(keyframe: Keyframe, *, age_ns: int = 0) -> Told:
    return Told(
        event_threshold=keyframe.event_threshold,
        counts=keyframe.counts.copy(),
        signs=keyframe.signs.copy(),
        lower=keyframe.lower,
        upper=keyframe.upper,
        age_s=keyframe.age_s + as_seconds(age_ns),
        events=keyframe.events,
    )
