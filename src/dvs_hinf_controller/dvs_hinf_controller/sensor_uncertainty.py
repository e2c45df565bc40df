"""How far a sensor may be from the ideal one, as bounds that the user vouches for."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorUncertainty:
    """Bounds on what a sensor does otherwise than an ideal one; all 0 for the ideal one.

    Parameters
    ----------
    threshold_on
        Largest relative error of a pixel's ON threshold, in [0, 1).
    threshold_off
        Largest relative error of a pixel's OFF threshold, in [0, 1).
    leak
        Largest rate of the ON events that leakage alone causes in a pixel, 1/s: its reference
        falls by at most this many thresholds a second.
    anchor
        Largest relative error of an absolute measurement of luminosity, in [0, 1).
    latency
        Longest time from what causes an event to its stamp, s.
    anchor_period
        Longest time from an absolute measurement to the arrival of the next one, s; 0 for none.

    Raises
    ------
    ParameterError
        If a bound is negative or not finite, or a relative one is not below 1.
    """

    threshold_on: float = 0.0
    threshold_off: float = 0.0
    leak: float = 0.0
    anchor: float = 0.0
    latency: float = 0.0
    anchor_period: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            is_relative = entry.name not in ('leak', 'latency', 'anchor_period')
            if not 0 <= value < (1 if is_relative else math.inf):
                rule = 'must be >= 0 and < 1' if is_relative else 'must be >= 0 and finite'
                is_bound = entry.name != 'anchor_period'
                raise ParameterError(entry.name + '_uncertainty' * is_bound, value, rule)

    @property
    def threshold(self) -> float:
        """Largest relative error of a threshold."""
        return max(self.threshold_on, self.threshold_off)

    @property
    def drifts(self) -> bool:
        """Whether what is known of a reference wears off while nothing measures it."""
        return self.threshold > 0 or self.leak > 0

    @property
    def is_covered(self) -> bool:
        """Whether what is known of a reference has a bound for ever."""
        return not self.drifts or self.anchor_period > 0

    @classmethod
    def of_scenario(cls, scenario: Scenario) -> SensorUncertainty:
        """Bounds of a scenario.

        Parameters
        ----------
        scenario
            Checked parameters.

        Raises
        ------
        ParameterError
            If threshold_uncertainty has more than two entries.
        """
        given = scenario.uncertainty
        thresholds = given.threshold_uncertainty or (0.0,)
        if len(thresholds) > 2:
            raise ParameterError(
                'threshold_uncertainty', thresholds, 'must have at most 2 entries, ON and OFF'
            )
        return cls(
            threshold_on=thresholds[0],
            threshold_off=thresholds[-1],
            leak=given.leak_uncertainty,
            anchor=given.anchor_uncertainty,
            latency=given.latency_uncertainty,
            anchor_period=given.anchor_period,
        )
