"""Integral action: the design for a plant that has an integrator before every input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import Equilibrium, PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem


def integrated_problem(problem: DesignProblem) -> DesignProblem:
    """The same problem for the plant with integrators: their states are free, but for a trace.

    Parameters
    ----------
    problem
        Problem of the plant itself.

    Raises
    ------
    ParameterError
        If the pixels do not see the integrators through the plant.
    """
    model, m = problem.model, problem.model.input_count
    n = model.state_count
    augmented = PlantModel(
        state_matrix=np.block(
            [[model.state_matrix, model.input_matrix], [np.zeros((m, n)), np.zeros((m, m))]]
        ),
        input_matrix=np.vstack([np.zeros((n, m)), np.eye(m)]),
        output_vector=np.concatenate(
            [model.output_vector, np.zeros((*model.output_vector.shape[:-1], m))], axis=-1
        ),
    )
    try:
        augmented.require_detectable()
    except ParameterError:
        raise ParameterError(
            'integral_action',
            True,
            f'needs pixels that show a constant load on each of the {m} inputs: one mean can not '
            'distinguish several loads, nor show one that the plant blocks or integrates',
        ) from None
    weights = np.ones(n) if problem.error_weights is None else problem.error_weights
    return replace(
        problem,
        model=augmented,
        equilibrium=Equilibrium(
            state=np.concatenate([problem.equilibrium.state, problem.equilibrium.feedforward]),
            feedforward=np.zeros(m),
            residual=problem.equilibrium.residual,
        ),
        error_weights=np.concatenate([weights, np.zeros(m)]),
        operation=None
        if problem.operation is None
        else replace(
            problem.operation,
            disturbance_bound=np.zeros(0),
            constant_load=np.zeros(0),
            further_plants=(),
            model_uncertainty=0.0,
        ),
        initial_state=None,
    )


def with_integrators(controller: LinearController) -> LinearController:
    """K followed by an integrator a command.

    Parameters
    ----------
    controller
        K of the plant with integrators.
    """
    order, m = controller.order, controller.input_count
    return LinearController(
        state_matrix=np.block(
            [
                [controller.state_matrix, np.zeros((order, m))],
                [controller.output_matrix, np.zeros((m, m))],
            ]
        ),
        input_vector=np.concatenate([controller.input_vector, controller.feedthrough]),
        output_matrix=np.hstack([np.zeros((m, order)), np.eye(m)]),
        feedthrough=np.zeros_like(controller.feedthrough),
    )
