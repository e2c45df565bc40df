"""The step of h, how far a sensor may miss it, and the intervals that follow from that alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import threshold_step
from dvs_hinf_controller.running.interval_arithmetic import (
    LARGEST_LOGARITHM,
    ROUNDING,
    SensorBounds,
)
from dvs_hinf_controller.running.packet_history import Passed
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


class Spacings(TypedDict):
    """Ratios of neighbouring references, as `analysis.sector` takes them."""

    on_spacing: float
    off_spacing: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBounds:
    """The step of a threshold, the largest that a pixel may have in its place, and the leak.

    Parameters
    ----------
    event_threshold
        h.
    step
        ``h ln b``.
    on
        Largest ON threshold, a natural logarithm.
    off
        Largest OFF threshold, a natural logarithm.
    uncertainty
        How far the sensor may be from an ideal one.
    """

    event_threshold: float
    step: float
    on: float
    off: float
    uncertainty: SensorUncertainty

    @classmethod
    def of(
        cls, event_threshold: float, *, log_base: float, uncertainty: SensorUncertainty
    ) -> StepBounds:
        """Bounds of a threshold.

        Parameters
        ----------
        event_threshold
            h.
        log_base
            b.
        uncertainty
            How far the sensor may be from an ideal one.
        """
        step = threshold_step(event_threshold, log_base)
        return cls(
            event_threshold=event_threshold,
            step=step,
            on=step * (1 + uncertainty.threshold_on),
            off=step * (1 + uncertainty.threshold_off),
            uncertainty=uncertainty,
        )

    @property
    def spacings(self) -> Spacings:
        """Ratios of neighbouring references."""
        return Spacings(on_spacing=math.exp(-self.on), off_spacing=math.exp(-self.off))

    @property
    def slacks(self) -> tuple[float, float]:
        """By how much an ON and an OFF threshold may miss the step."""
        return self.on - self.step, self.off - self.step

    def worn(self, given: SensorBounds) -> tuple[FloatArray, FloatArray]:
        """Ends that a sensor gives at this threshold, widened for what it may have done since.

        Parameters
        ----------
        given
            State of the sensor.
        """
        slack = given.events * self.step
        slack *= max(self.uncertainty.threshold_on, self.uncertainty.threshold_off)
        if slack > LARGEST_LOGARITHM:
            return np.zeros_like(given.lower), np.full_like(given.upper, np.inf)
        leaked = self.uncertainty.leak * given.age_s + bool(self.uncertainty.leak)
        return given.lower * math.exp(-slack - leaked * self.step), given.upper * math.exp(slack)

    def around(
        self, luminosity: FloatArray, *, counts: NDArray[np.int64], passed: Passed
    ) -> tuple[FloatArray, FloatArray]:
        """Ends around a measured luminosity, at N = 0, for what has happened since.

        A silent pixel has ``y rho_on < q < y / rho_off``; what has happened since the measurement
        moves and widens this interval like any other.

        Parameters
        ----------
        luminosity
            Measured y > 0, shape (r,).
        counts
            N of now, shape (r,).
        passed
            What has happened since the measurement.
        """
        error, (slack_on, slack_off) = self.uncertainty.anchor, self.slacks
        level = np.log(luminosity)
        level -= (counts - passed.on + passed.off) * self.step
        slack = passed.on * slack_on + passed.off * slack_off
        leaked = self.uncertainty.leak * self.step * passed.age_s
        below = self.on * (1 + passed.unsure_on) + self.off * passed.lost + slack + leaked
        above = self.off * (1 + passed.unsure_off) + self.on * passed.lost + slack
        with np.errstate(over='ignore'):
            lower = np.exp(level - below) * ((1 - ROUNDING) / (1 + error))
            upper = np.exp(level + above) * ((1 + ROUNDING) / (1 - error))
        return lower, upper
