"""What a controller holds with every one of several plants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.promise import Held, Promise
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors


def held_with_all(
    problem: DesignProblem,
    controller: LinearController,
    operation: Operation,
    *,
    rtol: float = 3e-4,
) -> Callable[..., Held]:
    """Bounds by the sectors of the pixels and by a start, the largest of all plants.

    A further plant does not hold the set-point by the feed-forward of the nominal one: what is
    left, ``A x_d + B u``, is a constant that moves its equilibrium.

    Parameters
    ----------
    problem
        Nominal plant, pixels and tolerance.
    controller
        K.
    operation
        How the loop runs, and the further plants.
    rtol
        Relative width that is aimed at in the peak gains.

    Returns
    -------
    Callable
        Of the sectors, and of ``x - x_d`` at the start, None for bounds in the limit.
    """
    held = problem.equilibrium
    promises = [Promise(problem, controller, operation, rtol=rtol)]
    for plant in operation.further_plants:
        drift = plant.state_matrix @ held.state + plant.input_matrix @ held.feedforward
        mine = replace(problem, model=plant)
        promises.append(Promise(mine, controller, operation, drift=drift, rtol=rtol))

    def worst(sectors: Sectors, start: FloatArray | None = None) -> Held:
        found = [promise.held(sectors, start=start) for promise in promises]
        return Held(
            error=max(one.error for one in found),
            output=max(one.output for one in found),
            commands=np.max([one.commands for one in found], axis=0),
            log_rate=max(one.log_rate for one in found),
        )

    return worst
