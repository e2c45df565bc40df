"""What h costs: h_certified against period, latency and bandwidth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError

UNITS = {'sampling_period': 's', 'loop_latency': 's', 'bandwidth_limit': 'rad/s'}
# Multiples of the scenario's own period, and of its inverse for the bandwidth.
_PERIODS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_LATENCIES = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
_BANDWIDTHS = tuple(np.geomspace(0.01, 1.0, 6).tolist())
_LONGEST_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParetoPoint:
    """A design with one parameter changed.

    Parameters
    ----------
    parameter
        Name of the parameter.
    value
        Its value.
    h_certified
        Guaranteed threshold; infinite for any, minus infinity for none or no controller.
    h_star
        Published threshold, likewise.
    fastest_pole
        Of the controller, rad/s; not a number without a controller.
    slowest_pole
        Largest real part of a closed-loop pole, 1/s; likewise.
    """

    parameter: str
    value: float
    h_certified: float
    h_star: float
    fastest_pole: float
    slowest_pole: float


def pareto(scenario: Scenario) -> Iterator[ParetoPoint]:
    """Designs of the scenario's method for other periods, latencies and bandwidths, one by one.

    Parameters
    ----------
    scenario
        Checked parameters.

    Raises
    ------
    ParameterError
        If no controller can exist, whatever the period.
    """
    DesignProblem.from_scenario(scenario)
    period = scenario.loop.sampling_period
    yield from _along(
        scenario,
        'sampling_period',
        [k * period for k in _PERIODS if k * period <= _LONGEST_PERIOD_S],
    )
    jitter = scenario.promise.loop_latency_jitter
    latencies = [max(k * period, jitter) for k in _LATENCIES]
    yield from _along(scenario, 'loop_latency', list(dict.fromkeys(latencies)))
    yield from _along(scenario, 'bandwidth_limit', [k / period for k in _BANDWIDTHS])


def _along(scenario: Scenario, name: str, values: Sequence[float]) -> Iterator[ParetoPoint]:
    for value in values:
        try:
            found = design_from_scenario(scenario.replace(**{name: value})).figures
        except (SynthesisError, ParameterError):
            none = -math.inf
            yield ParetoPoint(
                parameter=name,
                value=value,
                h_certified=none,
                h_star=none,
                fastest_pole=math.nan,
                slowest_pole=math.nan,
            )
            continue
        yield ParetoPoint(
            parameter=name,
            value=value,
            h_certified=found.h_certified,
            h_star=found.h_star,
            fastest_pole=found.fastest_pole,
            slowest_pole=found.closed_loop_abscissa,
        )
