"""What the sensor publishes of its own state, applied at the instant of its stamp."""

from __future__ import annotations

from collections import deque

import numpy as np

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import INDEX_MODULUS
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.running.interval_arithmetic import SensorBounds, require_finite
from dvs_hinf_controller.running.packet_history import Counted
from dvs_hinf_controller.running.reference_state import (
    NO_JUMPS,
    ReferenceState,
    Taken,
    sum_known,
)

# Packets of a sensor that may arrive before the keyframe of its start does.
_AHEAD_OF_KEYFRAME = 20
# Epochs before this one, and how many keyframes of one must arrive before it is taken again.
_PAST_EPOCHS = 64
_REPEATS = 3


class Keyframes:
    """Makes the references exact by the keyframes of a sensor, and follows its epochs.

    Parameters
    ----------
    state
        What is known of the references.
    """

    def __init__(self, state: ReferenceState) -> None:
        self._state = state
        self._epoch: int | None = None
        self._past_epochs: deque[int] = deque(maxlen=_PAST_EPOCHS)
        self._repeated = 0

    def take(self, keyframe: Keyframe) -> Taken:
        """Take a keyframe; one of a packet still to come waits for it.

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
        self._require_countable(keyframe)
        now_ns = self._state.gate.last_ns
        if now_ns is None:
            return self._start(keyframe)
        if keyframe.epoch != self._epoch:
            self._require_current(keyframe)
            return self._change_epoch(keyframe, now_ns)
        self._repeated = 0
        if keyframe.stamp_ns > now_ns:
            self._state.require_reach('keyframe', keyframe.stamp_ns, now_ns)
        return self._await(keyframe)

    def _require_countable(self, keyframe: Keyframe) -> None:
        known = self._state.intervals
        if keyframe.counts.size != known.counts.size:
            raise MessageError(
                f'keyframe of {keyframe.counts.size} pixels, the array has {known.counts.size}'
            )
        step = known.log_step * keyframe.event_threshold / known.event_threshold
        upper = np.where(np.isfinite(keyframe.upper), keyframe.upper, 1.0)
        require_finite(np.abs(keyframe.counts) * step + np.abs(np.log(upper)))

    def _require_current(self, keyframe: Keyframe) -> None:
        """Refuse a keyframe of an epoch that is over, unless nothing else arrives any more."""
        if keyframe.epoch not in self._past_epochs or not self._state.verified:
            return
        self._repeated += 1
        if self._repeated < _REPEATS:
            raise MessageError(f'keyframe of the epoch {keyframe.epoch}, which is over')

    def _await(self, keyframe: Keyframe) -> Taken:
        self._state.keyframes.add(keyframe)
        return Taken(jumps=NO_JUMPS, corrected=self.apply_due(self._state.gate.last_ns))

    # -- epochs -----------------------------------------------------------------------------------

    def _start(self, keyframe: Keyframe) -> Taken:
        """Begin with a keyframe, before any packet."""
        state = self._state
        self._enter(keyframe.epoch)
        corrected = state.intervals.restart(_bounds_given(keyframe))
        state.index = IndexWatch(expected=keyframe.next_index)
        state.keyframes.clear()
        state.keyframes.add(keyframe)
        return Taken(jumps=NO_JUMPS, corrected=corrected)

    def _enter(self, epoch: int) -> None:
        if self._epoch is not None and self._epoch != epoch:
            self._past_epochs.append(self._epoch)
        self._epoch, self._repeated = epoch, 0

    def _change_epoch(self, keyframe: Keyframe, now_ns: int) -> Taken:
        """Another sensor, or the same one started again."""
        state = self._state
        if self._epoch is None and not state.history.reaches(keyframe.stamp_ns):
            # The first packets were of the midst of its epoch; the next keyframe is within reach.
            self._epoch = keyframe.epoch
            state.forget(now_ns)
            return Taken(jumps=NO_JUMPS)
        if self._epoch is None or self._is_of_these_times(keyframe, now_ns):
            return self._await(keyframe)
        state.gate.restart(None)
        state.begin_anew(IndexWatch())
        corrected = self._start(keyframe).corrected
        return Taken(jumps=NO_JUMPS, anew=True, corrected=corrected)

    def _is_of_these_times(self, keyframe: Keyframe, now_ns: int) -> bool:
        """Whether the sensor has started again while time went on, and not with a new time."""
        state = self._state
        if keyframe.stamp_ns > now_ns:
            return state.gate.follows(keyframe.stamp_ns)
        later = state.history.packets_after(keyframe.stamp_ns)
        if not state.history.reaches(keyframe.stamp_ns) or len(later) > _AHEAD_OF_KEYFRAME:
            return False
        first = next((p.first_index for p in later if p.first_index is not None), None)
        return first is None or first == keyframe.next_index

    # -- instants ---------------------------------------------------------------------------------

    def apply_due(self, now_ns: int | None, *, is_over: bool = False) -> int | None:
        """Apply the keyframes whose packet is there, in order; return the pixels put right.

        One that changes the threshold waits until the sample of its stamp is over: only then has
        every pixel been compared with the new one.

        Parameters
        ----------
        now_ns
            Stamp of the last packet, ns; None before the first.
        is_over
            Whether all packets of that stamp are there.
        """
        state = self._state
        corrected = None
        while (keyframe := state.keyframes.first) is not None and now_ns is not None:
            is_due = keyframe.stamp_ns <= now_ns
            waits = keyframe.stamp_ns == now_ns and not is_over and self._changes_step(keyframe)
            if not is_due or waits:
                break
            state.keyframes.pop()
            if state.history.reaches(keyframe.stamp_ns):
                corrected = sum_known(corrected, self._apply(keyframe, now_ns))
        return corrected

    def _changes_step(self, keyframe: Keyframe) -> bool:
        is_other = keyframe.event_threshold != self._state.intervals.event_threshold
        return is_other and keyframe.epoch == self._epoch

    def _apply(self, keyframe: Keyframe, now_ns: int) -> int:
        state, known = self._state, self._state.intervals
        later = state.history.packets_after(keyframe.stamp_ns)
        given = _bounds_given(keyframe, age_ns=now_ns - keyframe.stamp_ns)
        for packet in later:
            np.add.at(given.counts, packet.pixels, packet.polarities)
            given.signs[packet.pixels] = packet.signs
        if keyframe.epoch != self._epoch:
            self._enter(keyframe.epoch)
            state.valid_from_ns = keyframe.stamp_ns
            self._expect(keyframe, later)
            corrected = known.restart(given) or 0
        elif self._changes_step(keyframe):
            state.valid_from_ns = keyframe.stamp_ns
            if not any(len(packet.pixels) for packet in later):
                known.change_threshold(keyframe.event_threshold)
            corrected = known.restart(given) or 0
        else:
            missing = self._missing(keyframe)
            if missing:
                known.lose(missing)
                self._expect(keyframe, later)
            corrected = known.confirm(given)
        state.verified = True
        return corrected

    def _expect(self, keyframe: Keyframe, later: list[Counted]) -> None:
        numbers = [packet.next_index for packet in later if packet.next_index is not None]
        self._state.index = IndexWatch(expected=numbers[-1] if numbers else keyframe.next_index)

    def _missing(self, keyframe: Keyframe) -> int:
        """Events before a keyframe's stamp that no packet has brought and no gap has shown."""
        expected = self._state.history.next_index_at(keyframe.stamp_ns)
        if expected is None:
            return 0
        missing = (keyframe.next_index - expected) % INDEX_MODULUS
        return missing if missing < INDEX_MODULUS // 2 else 0


def _bounds_given(keyframe: Keyframe, *, age_ns: int = 0) -> SensorBounds:
    return SensorBounds(
        event_threshold=keyframe.event_threshold,
        counts=keyframe.counts.copy(),
        signs=keyframe.signs.copy(),
        lower=keyframe.lower,
        upper=keyframe.upper,
        age_s=keyframe.age_s + as_seconds(age_ns),
        events=keyframe.events,
    )
