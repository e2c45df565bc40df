"""The states in units of the error, so that a norm of x is one of W x."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.settling import settled


def in_error_units(problem: DesignProblem, model: PlantModel) -> PlantModel:
    """A plant with the state ``W x``, which has the same controllers.

    W is divided by the geometric mean of its entries: equal weights change nothing. Where a state
    is free there is no such plant, and the one that is given stays.

    Parameters
    ----------
    problem
        What is asked.
    model
        Its plant, or one with the same states.
    """
    weights = problem.error_weights
    if weights is None or not weights.all():
        return model
    weights = weights / np.exp(np.mean(np.log(weights)))
    return replace(
        model,
        state_matrix=model.state_matrix * weights[:, None] / weights,
        input_matrix=model.input_matrix * weights[:, None],
        output_vector=model.output_vector / weights,
    )


def for_the_error(
    problem: DesignProblem, synthesize: Callable[[PlantModel], LinearController]
) -> LinearController:
    """Controller of a method for the norm of x only, for that of W x, settling in time.

    Parameters
    ----------
    problem
        What is asked.
    synthesize
        Finds a stabilizing controller of a plant.
    """
    return settled(problem, lambda model: synthesize(in_error_units(problem, model)))
