"""Absolute measurements of the luminosity, which cut what is known of the references."""

from __future__ import annotations

import numpy as np

from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_hinf_controller.running.pixel_health import PixelHealth
from dvs_hinf_controller.running.reference_state import NO_JUMPS, ReferenceState, Taken


class Anchors:
    """Cuts the references by anchors, and masks the pixels that anchors contradict.

    Parameters
    ----------
    state
        What is known of the references.
    health
        Which pixels are used.
    latency_ns
        Longest time from what causes an event to its stamp, ns.
    """

    def __init__(self, state: ReferenceState, health: PixelHealth, *, latency_ns: int) -> None:
        self._state = state
        self._health = health
        self._latency_ns = latency_ns
        self.used = self.unused = self.contradictions = 0

    def take(self, anchor: Anchor) -> Taken:
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
        pixel_count = self._state.intervals.counts.size
        if anchor.luminosity.size != pixel_count:
            raise MessageError(
                f'anchor of {anchor.luminosity.size} pixels, the array has {pixel_count}'
            )
        now_ns = self._state.gate.last_ns
        if now_ns is not None and anchor.stamp_ns > now_ns:
            self._state.require_reach('anchor', anchor.stamp_ns, now_ns)
        self._state.anchors.add(anchor)
        return Taken(jumps=NO_JUMPS, contradicted=self.apply_due())

    def apply_due(self) -> int:
        """Cut by the anchors whose events are all there; return the pixels contradicted."""
        contradicted = 0
        now_ns, waiting = self._state.gate.last_ns, self._state.anchors
        while (anchor := waiting.first) is not None and now_ns is not None:
            if anchor.stamp_ns + self._latency_ns > now_ns:
                break
            waiting.pop()
            if self._is_usable(anchor):
                contradicted += self._cut(anchor, now_ns)
            else:
                self.unused += 1
        return contradicted

    def _is_usable(self, anchor: Anchor) -> bool:
        valid_from_ns = self._state.valid_from_ns
        is_later = valid_from_ns is None or anchor.stamp_ns >= valid_from_ns
        return is_later and self._state.history.reaches(anchor.stamp_ns)

    def _cut(self, anchor: Anchor, now_ns: int) -> int:
        passed = self._state.history.since(
            anchor.stamp_ns,
            now_ns=now_ns,
            latency_ns=self._latency_ns,
            pixel_count=anchor.luminosity.size,
        )
        cut = self._state.intervals.cut(anchor.luminosity, passed)
        self.used += 1
        if self._health.note(cut.confirmed, cut.contradicted):
            self._state.intervals.restrict_to(self._health.healthy)
        number = int(np.count_nonzero(cut.contradicted))
        self.contradictions += number
        return number
