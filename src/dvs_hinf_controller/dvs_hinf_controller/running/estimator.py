"""The zero-order-hold estimator: from counted polarities to the estimate of every luminosity."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds, threshold_step
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.analysis.sector import sector

# Beyond this a luminosity and what K makes of it are no longer numbers.
_LARGEST_LOGARITHM = 300.0


class Estimator:
    """``z_i = s_i lambdabar_i rho^(-N_i)`` with the integer N_i (paper, eqs. 12, 13; Theorem 3).

    Parameters
    ----------
    bounds
        What is known of q(0).
    event_threshold
        h, in logarithms to the base b.
    log_base
        b.
    """

    def __init__(
        self, bounds: ReferenceBounds, *, event_threshold: float, log_base: float
    ) -> None:
        self._log_base = log_base
        self.counts: NDArray[np.int64] = np.zeros(bounds.lower.size, dtype=np.int64)
        self.signs: NDArray[np.int8] = np.ones(bounds.lower.size, dtype=np.int8)
        self._first_bounds = bounds
        self._start_epoch(np.zeros(bounds.lower.size), event_threshold)
        self.estimate = self._initial.copy()

    def _start_epoch(self, moved: FloatArray, event_threshold: float) -> None:
        """Begin to count at zero where every reference is b^moved times what it was at first."""
        growth = np.exp(moved * math.log(self._log_base))
        bounds = ReferenceBounds(
            lower=self._first_bounds.lower * growth, upper=self._first_bounds.upper * growth
        )
        log_step = threshold_step(event_threshold, self._log_base)
        self._initial = sector(
            bounds, event_threshold=event_threshold, log_base=self._log_base
        ).initial_estimate
        self._moved, self.event_threshold, self._log_step = moved, event_threshold, log_step

    def change_threshold(self, event_threshold: float) -> None:
        """Go on with another threshold: the references stay, counting starts again at zero.

        A reference that has been counted N times lies between ``m rho^-N`` and ``M rho^-N``: these
        are the bounds of the new epoch.

        Parameters
        ----------
        event_threshold
            New h.
        """
        moved = self._moved + self.counts * self.event_threshold
        self.counts = np.zeros_like(self.counts)
        self._start_epoch(moved, event_threshold)
        self.estimate = self.signs * self._initial

    def adopt(self, keyframe: Keyframe) -> int:
        """Take over counts from the sensor itself; return how many pixels they change.

        Parameters
        ----------
        keyframe
            State of the sensor at this instant and this threshold.

        Raises
        ------
        MessageError
            If an estimate would leave the range of numbers; nothing has changed then.
        """
        counts, signs, moved = keyframe.counts, keyframe.signs, keyframe.moved
        is_wrong = (counts != self.counts) | (signs != self.signs) | (moved != self._moved)
        _require_finite(counts * self._log_step + moved * math.log(self._log_base))
        if not np.array_equal(moved, self._moved):
            self._start_epoch(moved, self.event_threshold)
        wrong = np.flatnonzero(is_wrong)
        self.counts[wrong] = counts[wrong]
        self.signs[wrong] = signs[wrong]
        self.estimate[wrong] = (
            signs[wrong] * self._initial[wrong] * np.exp(counts[wrong] * self._log_step)
        )
        return int(wrong.size)

    def apply(
        self, pixels: NDArray[np.intp], polarities: NDArray[np.int8], signs: NDArray[np.int8]
    ) -> FloatArray:
        """Count events; return the jump of the mean estimate at each of them, shape (E,).

        Parameters
        ----------
        pixels
            Row-major pixel of every event in the order of time, shape (E,).
        polarities
            +1 or -1, shape (E,).
        signs
            Sign of the reference after the event, shape (E,).

        Raises
        ------
        MessageError
            If an estimate would leave the range of numbers; nothing has changed then.
        """
        order = np.argsort(pixels, kind='stable')
        pixel, sign = pixels[order], signs[order]
        is_first = np.ones(len(pixel), dtype=bool)
        is_first[1:] = pixel[1:] != pixel[:-1]
        running = np.cumsum(polarities[order], dtype=np.int64)
        group = np.cumsum(is_first) - 1
        before_group = np.concatenate(([0], running))[np.flatnonzero(is_first)]
        counts = self.counts[pixel] + running - before_group[group]
        logarithm = counts * self._log_step
        _require_finite(logarithm)
        after = sign * self._initial[pixel] * np.exp(logarithm)
        before = np.empty_like(after)
        before[1:] = after[:-1]
        before[is_first] = self.estimate[pixel[is_first]]
        is_last = np.ones(len(pixel), dtype=bool)
        is_last[:-1] = is_first[1:]
        self.counts[pixel[is_last]] = counts[is_last]
        self.signs[pixel[is_last]] = sign[is_last]
        self.estimate[pixel[is_last]] = after[is_last]
        jumps: FloatArray = np.empty_like(after)
        jumps[order] = (after - before) / self.estimate.size
        return jumps


def _require_finite(logarithm: FloatArray) -> None:
    """Refuse counts that no luminosity explains: noise, or another camera's."""
    largest = float(np.max(np.abs(logarithm), initial=0.0))
    if not largest < _LARGEST_LOGARITHM:
        raise MessageError(
            f'a reference would be e^{largest:.6g} times what it was at first: no light does that'
        )
