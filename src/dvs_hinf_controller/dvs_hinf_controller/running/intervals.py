"""What is known of every reference, at every instant: an interval that rules move and cut.

A pixel's reference is ``q = q0 rho^-N`` with the integer N that both sensor and estimator count,
and ``m <= q0 <= M``. An event moves the interval rigidly, by N alone, so that nothing accumulates
where nothing is uncertain; whatever else may have happened widens ``[m, M]``, and an absolute
measurement cuts it (docs/theory.md).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.sector import best_error, best_estimate
from dvs_hinf_controller.running.compiled_events import CompiledEvents, Events
from dvs_hinf_controller.running.interval_arithmetic import (
    LARGEST_LOGARITHM,
    ROUNDING,
    UNKNOWN_WIDTH,
    Bools,
    Cut,
    SensorBounds,
    common_part,
    half_widths,
    require_finite,
)
from dvs_hinf_controller.running.packet_history import Passed
from dvs_hinf_controller.running.pixel_records import CarriedMean, PixelRecords
from dvs_hinf_controller.running.pixel_turns import PixelTurns, kernels_for
from dvs_hinf_controller.running.step_bounds import StepBounds
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


class ReferenceIntervals:
    """The interval of every reference and the best estimate of every luminosity from it.

    Parameters
    ----------
    bounds
        What is known of q at the start, where N = 0.
    event_threshold
        h, in logarithms to the base b.
    log_base
        b.
    uncertainty
        How far the sensor may be from an ideal one.
    compiled
        Whether packets of many events go through compiled code, where it is installed.
    """

    def __init__(
        self,
        bounds: ReferenceBounds,
        *,
        event_threshold: float,
        log_base: float,
        uncertainty: SensorUncertainty,
        compiled: bool = True,
    ) -> None:
        size = bounds.lower.size
        self._log_base = log_base
        self._uncertainty = uncertainty
        self._compiled = compiled
        self._records = records = PixelRecords(size)
        self.counts, self.signs, self.active = records.counts, records.signs, records.active
        self.first, self.estimate = records.first, records.estimate
        self._mean = CarriedMean(records)
        self._healthy: Bools = np.ones(size, bool)
        self._widest = 0.0
        self._set_step(event_threshold)
        # Of a reference that may have leaked since it was set, one step is not known.
        leaked = math.exp(-self._step) if uncertainty.leak else 1.0
        self._begin(bounds.lower * leaked, bounds.upper)

    def _set_step(self, event_threshold: float) -> None:
        self.step_bounds = self._bounds_of(event_threshold)
        self._step, self._spacings = self.step_bounds.step, self.step_bounds.spacings
        self._events = CompiledEvents(self._records, self._step)

    def _bounds_of(self, event_threshold: float) -> StepBounds:
        return StepBounds.of(
            event_threshold, log_base=self._log_base, uncertainty=self._uncertainty
        )

    def _begin(self, lower: FloatArray, upper: FloatArray) -> None:
        self.lower, self.upper = lower.copy(), upper.copy()
        # The intervals without what losses have added, as long as counts may be wrong.
        self._counted: tuple[FloatArray, FloatArray] | None = None
        self._renew()

    @property
    def width(self) -> float:
        """``max w`` of the active pixels; infinite where a count may be wrong."""
        return float(self.half_widths.max(where=self.active, initial=0.0))

    def read_widest(self) -> float:
        """Largest `width` since the last reading."""
        widest, self._widest = self._widest, self.width
        return widest

    @property
    def has_lost(self) -> bool:
        """Whether events are missing that no keyframe has accounted for."""
        return self._counted is not None

    @property
    def farthest_count(self) -> int:
        """Bound of ``|N|`` of all pixels."""
        return int(self._records.farthest[0])

    @property
    def event_threshold(self) -> float:
        """h."""
        return self.step_bounds.event_threshold

    @property
    def log_step(self) -> float:
        """``h ln b``."""
        return self._step

    @property
    def log_thresholds(self) -> float:
        """``h ln b`` with the uncertainty of the thresholds, the mean of ON and OFF."""
        return 0.5 * (self.step_bounds.on + self.step_bounds.off)

    @property
    def error_bounds(self) -> FloatArray:
        """``delta_i``, bound of ``|z_i - y_i| / |y_i|``, shape (r,); 1 where nothing is known."""
        known = self.known
        bound = np.ones(self.lower.size)
        bound[known] = best_error(self.lower[known], self.upper[known], **self._spacings)
        return bound

    @property
    def mean_estimate(self) -> float:
        """Mean of the estimates of the active pixels; 0 if there are none."""
        return self._mean.of(self.active_count)

    def _renew(self) -> None:
        """Work out the estimates of the present intervals."""
        lower, upper = self._ends
        # ``w = 1/2 ln(M/m)``, infinite where nothing is known, and what is known well enough.
        self.half_widths = half_widths(lower, upper)
        self.known = usable = self.half_widths <= UNKNOWN_WIDTH
        if self._counted is not None:
            # Better a count that may be wrong than no estimate; it is not called certified.
            lower = np.where(usable, lower, self._counted[0])
            upper = np.where(usable, upper, self._counted[1])
            usable = half_widths(lower, upper) <= UNKNOWN_WIDTH
        if usable.all():
            self.first[:] = best_estimate(lower, upper, **self._spacings)
        else:
            self.first[:] = 0.0
            self.first[usable] = best_estimate(lower[usable], upper[usable], **self._spacings)
        self._usable = usable
        self.estimate[:] = self.signs * self.first * np.exp(self.counts * self._step)
        self._choose()

    def _choose(self) -> None:
        np.logical_and(self._usable, self._healthy, out=self.active)
        self._mean.forget()
        self.active_count = int(np.count_nonzero(self.active))
        self._all_active = self.active_count == self.active.size
        # Healthy pixels whose reference is not known.
        self.unknown_count = int(np.count_nonzero(self._healthy & ~self.known))
        self._widest = max(self._widest, self.width)

    def restrict_to(self, healthy: Bools) -> None:
        """Take the mean over these pixels from now on, as far as they are known.

        Parameters
        ----------
        healthy
            Shape (r,).
        """
        self._healthy = healthy
        self._choose()

    # -- rules that move and widen ----------------------------------------------------------------

    def apply(
        self, pixels: NDArray[np.intp], polarities: NDArray[np.int8], signs: NDArray[np.int8]
    ) -> FloatArray:
        """Count events; return the jump of the mean estimate at each of them, shape (E,).

        Parameters
        ----------
        pixels
            Row-major pixel of every event in the order of time, shape (E,), E > 0.
        polarities
            +1 or -1, shape (E,).
        signs
            Sign of the reference after the event, shape (E,).

        Raises
        ------
        MessageError
            If an estimate would leave the range of numbers; nothing has changed then.
        """
        kernels = kernels_for(len(pixels)) if self._compiled else None
        if kernels is None:
            jumps = self._apply(pixels, polarities, signs)
        else:
            events = Events(pixels=pixels, polarities=polarities, signs=signs)
            jumps = self._apply_compiled(kernels, events)
        self._mean.add(jumps)
        return jumps

    def _apply(
        self, pixels: NDArray[np.intp], polarities: NDArray[np.int8], signs: NDArray[np.int8]
    ) -> FloatArray:
        turns = PixelTurns(pixels, polarities, self.counts)
        logarithm = turns.counts * self._step
        require_finite(logarithm)
        before = self.estimate[turns.pixel]
        self._widen_for_mismatch(pixels, polarities)
        after = signs[turns.order] * self.first[turns.pixel] * np.exp(logarithm)
        before[1:] = np.where(turns.is_first[1:], before[1:], after[:-1])
        last = turns.pixel[turns.is_last]
        self.counts[last] = turns.counts[turns.is_last]
        self._records.note_farthest(turns.counts)
        self.signs[last] = signs[turns.order][turns.is_last]
        self.estimate[last] = after[turns.is_last]
        jumps: FloatArray = np.empty_like(after)
        jumps[turns.order] = (after - before) / max(self.active_count, 1)
        return jumps if self._all_active else np.where(self.active[pixels], jumps, 0.0)

    def _apply_compiled(self, kernels: Any, events: Events) -> FloatArray:
        jumps = self._events.take(kernels, events, self.active_count)
        if not any(self.step_bounds.slacks):
            return jumps
        # Countable all; the estimates after them are those of wider intervals.
        self._events.take_back(kernels, events)
        self._widen_for_mismatch(events.pixels, events.polarities)
        return self._events.take(kernels, events, self.active_count)

    def _widen_for_mismatch(self, pixels: NDArray[np.intp], polarities: NDArray[np.int8]) -> None:
        """Widen for events of thresholds that are not quite h; the estimates follow later."""
        if not any(self.step_bounds.slacks):
            return
        slack = np.where(polarities > 0, *self.step_bounds.slacks)
        grown = np.exp(np.bincount(pixels, weights=slack, minlength=self.lower.size))
        self._stretch(1 / grown, grown)
        estimate = self.estimate.copy()
        self._renew()
        self.estimate[:] = estimate

    def _stretch(self, down: FloatArray | float, up: FloatArray | float) -> None:
        """Multiply the ends of all intervals."""
        self.lower *= down
        self.upper *= up
        if self._counted is not None:
            lower, upper = self._counted
            self._counted = lower * down, upper * up

    def leak(self, duration_s: float) -> None:
        """Let references fall for a time by as much as leakage may make them.

        Parameters
        ----------
        duration_s
            Time, s.
        """
        if self._uncertainty.leak:
            self._stretch(math.exp(-self._uncertainty.leak * self._step * duration_s), 1.0)
            self._renew()

    def lose(self, count: int) -> None:
        """Widen for events that never came, of whatever pixels.

        Parameters
        ----------
        count
            How many, > 0.
        """
        if not self._usable.any():
            return
        # Of one threshold too many or too few to be a number.
        most = LARGEST_LOGARITHM / self._step
        up, down = (
            math.exp(x * min(count, most)) for x in (self.step_bounds.on, -self.step_bounds.off)
        )
        if self._counted is None:
            self._counted = self.lower.copy(), self.upper.copy()
        # A missing ON event hides a rise of the reference, a missing OFF event a fall.
        self.lower *= 0.0 if count > most else down
        self.upper *= math.inf if count > most else up
        mismatch = math.exp(min(count, most) * max(self.step_bounds.slacks))
        lower, upper = self._counted
        self._counted = lower / mismatch, upper * mismatch
        self._renew()

    def change_threshold(self, event_threshold: float) -> None:
        """Go on with another threshold: the references stay, counting starts again at zero.

        Parameters
        ----------
        event_threshold
            New h.
        """
        growth = np.exp(self.counts * self._step)
        self._stretch(growth, growth)
        self._records.set_counts(np.zeros_like(self.counts), self.signs)
        self._set_step(event_threshold)
        self._renew()

    def forget(self) -> None:
        """Forget all bounds: the references may be anywhere."""
        self._begin(np.zeros_like(self.lower), np.full_like(self.upper, np.inf))

    # -- rules that narrow ------------------------------------------------------------------------

    def restart(self, given: SensorBounds) -> int | None:
        """Begin with the bounds that the sensor gives; return how many pixels that changes.

        Parameters
        ----------
        given
            State of the sensor.

        Returns
        -------
        int or None
            None where it adds nothing to what was known: not a bit changes then.
        """
        ends = self._bounds_of(given.event_threshold).worn(given)
        same_step = given.event_threshold == self.event_threshold
        wrong = self._differs(given)
        near = [np.abs(a - b) <= ROUNDING * b for a, b in zip(ends, self._ends, strict=True)]
        if same_step and self._counted is None and not wrong.any() and np.all(near):
            return None
        moved = wrong | ~np.logical_and(*near)
        self._records.set_counts(given.counts, given.signs)
        self._set_step(given.event_threshold)
        self._begin(*ends)
        return int(np.count_nonzero(moved))

    def confirm(self, given: SensorBounds) -> int:
        """Take over true counts; return for how many pixels they were others.

        What losses have added goes, and the bounds of the sensor narrow what is left.

        Parameters
        ----------
        given
            State of the sensor, in the epoch and at the threshold that it was in.
        """
        wrong = self._differs(given)
        if self._counted is None and wrong.any():
            return self.restart(given) or 0
        ends = self._bounds_of(given.event_threshold).worn(given)
        if self._counted is None:
            narrowed = common_part(self._ends, ends)
            if not all(map(np.array_equal, narrowed, self._ends)):
                self._begin(*narrowed)
            return 0
        # Wherever the reference was seen to be, its number now has another name.
        shift = np.exp((self.counts - given.counts) * self._step)
        seen = (self.lower * shift, self.upper * shift)
        self._records.set_counts(given.counts, given.signs)
        self._begin(*common_part(common_part(self._counted, seen), ends))
        return int(np.count_nonzero(wrong))

    @property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        return self.lower, self.upper

    def _differs(self, given: SensorBounds) -> Bools:
        return np.asarray((given.counts != self.counts) | (given.signs != self.signs))

    def cut(self, luminosity: FloatArray, passed: Passed) -> Cut:
        """Cut the intervals with absolute measurements.

        Where a measured interval has no point in common with what was known, that was wrong, and
        the measured one takes its place.

        Parameters
        ----------
        luminosity
            Measured y, shape (r,); a pixel where it is not > 0 and finite was not measured.
        passed
            What has happened since.
        """
        measured = (luminosity > 0) & np.isfinite(luminosity)
        lower, upper = self.step_bounds.around(
            np.where(measured, luminosity, 1.0), counts=self.counts, passed=passed
        )
        contradicted = measured & ((lower > self.upper) | (upper < self.lower))
        confirmed = measured & ~contradicted
        np.maximum(self.lower, lower, out=self.lower, where=confirmed)
        np.minimum(self.upper, upper, out=self.upper, where=confirmed)
        np.copyto(self.lower, lower, where=contradicted)
        np.copyto(self.upper, upper, where=contradicted)
        self._renew()
        return Cut(confirmed=confirmed, contradicted=contradicted)
