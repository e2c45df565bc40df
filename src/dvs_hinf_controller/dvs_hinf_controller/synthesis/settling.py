"""A loop that settles in time: the design for a plant whose modes are moved to the right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem


def settled(
    problem: DesignProblem, synthesize: Callable[[PlantModel], LinearController]
) -> LinearController:
    """Controller whose closed-loop poles all decay at `problem.least_decay`, or faster.

    K(s + sigma) for a controller K of ``(A + sigma I, B, c)`` moves all poles of that loop to the
    left by sigma (Anderson and Moore 1971, section 4.1).

    Parameters
    ----------
    problem
        Plant and settling time.
    synthesize
        Finds a stabilizing controller of a plant.

    Raises
    ------
    ParameterError
        If a mode that is too slow can't be moved or is not seen.
    """
    rate, model = problem.least_decay, problem.model
    if rate == 0:
        return synthesize(model)
    shifted = replace(model, state_matrix=model.state_matrix + rate * np.eye(model.state_count))
    try:
        shifted.require_stabilizable()
        shifted.require_detectable()
    except ParameterError as error:
        raise ParameterError(
            'settling_time',
            problem.settling_time,
            f'asks every mode to decay at {rate:.4g} 1/s, but {error.name} leaves a slower one '
            'out of reach',
        ) from None
    found = synthesize(shifted)
    return replace(found, state_matrix=found.state_matrix - rate * np.eye(found.order))
