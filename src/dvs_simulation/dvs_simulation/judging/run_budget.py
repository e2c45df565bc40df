"""What a run used of the budget of its certificate, by its worst moment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds, threshold_step
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.problem import unmasked
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty


@dataclass(frozen=True, slots=True, kw_only=True)
class RunBudget:
    """The budget of a whole run.

    Parameters
    ----------
    worst
        Its least favourable moment.
    is_certified
        Whether h is certified and no moment was worse than the start and not certified; with a
        sensor in error whether no moment at all was not certified, where that was reported.
    error_bounds
        ``delta_z`` of every pixel, shape (r,); infinite for one that was masked for a while.
    masked_pixels
        How many were.
    """

    worst: Budget
    is_certified: bool
    error_bounds: FloatArray
    masked_pixels: int


def run_budget(
    scenario: Scenario,
    bounds: ReferenceBounds,
    *,
    delta_certified: float,
    h_certified: float,
    reported: Sequence[Budget],
) -> RunBudget:
    """Budget of a run.

    The bound of a sensor that need not be ideal is ``tanh(h ln b + max w)`` of the worst moment:
    what events, leakage and anchors do to its references is not known before.

    Parameters
    ----------
    scenario
        Parameters of the run.
    bounds
        What was known of the references at its start.
    delta_certified
        Relative error of the estimate up to which the tolerance is guaranteed.
    h_certified
        Threshold up to which it is, whatever a sensor within its bounds does.
    reported
        What the controller reported of its budget, in any order.
    """
    mask, size = scenario.uncertainty.pixel_mask, bounds.lower.size
    healthy = unmasked(size, mask)
    step = threshold_step(scenario.sensor.event_threshold, scenario.sensor.log_base)
    counted = ReferenceBounds(lower=bounds.lower[healthy], upper=bounds.upper[healthy])
    start = Budget.at_start(counted, step, delta_certified)
    worse = [budget for budget in reported if budget.is_worse_than(start)]
    error_bounds = sector(
        bounds,
        event_threshold=scenario.sensor.event_threshold,
        log_base=scenario.sensor.log_base,
    ).error_bound.copy()
    within = scenario.sensor.event_threshold <= h_certified
    if SensorUncertainty.of_scenario(scenario) != SensorUncertainty():
        within = within or (bool(reported) and start.is_certified)
        used = max(budget.used for budget in (start, *reported))
        np.maximum(error_bounds, math.tanh(used), out=error_bounds)
    masked = set(mask).union(*(budget.masked_pixels for budget in reported)) & set(range(size))
    error_bounds[sorted(masked)] = math.inf
    return RunBudget(
        worst=max((start, *worse), key=lambda budget: (budget.unknown_pixels, -budget.left)),
        is_certified=within and all(budget.is_certified for budget in worse),
        error_bounds=error_bounds,
        masked_pixels=len(masked),
    )
