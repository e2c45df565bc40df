"""Maximise the certified threshold: peak-to-peak (L1) design by linear programming."""

from __future__ import annotations

import math

import numpy as np
import scipy.optimize
import scipy.sparse

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.peak_gain import (
    SampledKernel,
    peak_gains,
    steepest_direction,
    trapezoidal_weights,
)
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.order_reduction import reduced_controllers
from dvs_hinf_controller.synthesis.rolled_off import plant_rate
from dvs_hinf_controller.synthesis.structured import synthesize_structured
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError
from dvs_hinf_controller.synthesis.youla import YoulaFamily

# Filter poles: an octave apart, up to this multiple of the plant's own rate.
_FASTEST_FILTER = 100.0
_MAX_FILTERS = 9
_OBSERVER_RATE = 2.0
_MAX_CUTS = 6
_CUT_RTOL = 2e-3
_REDUCTION_LOSS = 2e-3
_COMPARISON_RTOL = 1e-3


def synthesize_certified(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Controller with (nearly) the largest h_certified.

    Minimises ``N_G Dbar + eps N_T``, a convex function of the closed loop (Dahleh and Pearson
    1987), over a Youla family whose filters are no faster than the bandwidth limit; then takes the
    lowest order that loses next to nothing. The structured controller is kept where it is better.

    Parameters
    ----------
    problem
        Plant, luminosities and tolerance.
    options
        Bandwidth limit; slack and process noise of the structured alternative.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable.
    """
    model = problem.model
    structured = synthesize_structured(model, options)
    family = YoulaFamily.around_observer(
        model, _filter_poles(model, options), rate=_OBSERVER_RATE * plant_rate(model)
    )
    full = family.controller(_optimal_coefficients(problem, family))
    candidates = [structured, full]
    if math.isfinite(_objective(problem, full)):
        candidates += reduced_controllers(model, full)
    values = [_objective(problem, candidate) for candidate in candidates]
    limit = min(values) * (1 + _REDUCTION_LOSS)
    if not math.isfinite(limit):
        return structured
    good = [pair[1] for pair in zip(values, candidates, strict=True) if pair[0] <= limit]
    return min(good, key=lambda candidate: candidate.order)


def _filter_poles(model: PlantModel, options: DesignOptions) -> FloatArray:
    rate = plant_rate(model)
    fastest = _FASTEST_FILTER * rate
    if options.bandwidth_limit > 0:
        fastest = min(fastest, options.bandwidth_limit)
    modes = np.linalg.eigvals(model.state_matrix)
    unstable = np.abs(modes[modes.real > 1e-9 * rate])
    slowest = min(max(float(np.min(unstable, initial=rate)), 0.1 * rate), fastest / 2)
    count = min(_MAX_FILTERS, 1 + math.ceil(math.log2(fastest / slowest)))
    return np.geomspace(slowest, fastest, count)


def _optimal_coefficients(problem: DesignProblem, family: YoulaFamily) -> FloatArray:
    """Cutting planes: a direction v enters once ``integral |v'g|`` exceeds what is accounted."""
    times = family.time_grid()
    nominal, responses = family.responses(times)
    weights = trapezoidal_weights(times)
    theta = np.zeros(family.coefficient_count)
    directions: list[FloatArray] = []
    for _ in range(_MAX_CUTS):
        kernel = SampledKernel(
            times=times,
            values=nominal + responses @ theta,
            weights=weights,
            quadrature_error=0.0,
            tail=0.0,
        )
        v = steepest_direction(kernel)
        worst = float(kernel.integral(v[:, None])[0])
        accounted = max(
            (float(kernel.integral(known[:, None])[0]) for known in directions), default=0.0
        )
        if worst <= accounted * (1 + _CUT_RTOL):
            break
        directions.append(v)
        theta = _linear_program(problem, weights, nominal, responses, directions)
    return theta


def _linear_program(
    problem: DesignProblem,
    weights: FloatArray,
    nominal: FloatArray,
    responses: FloatArray,
    directions: list[FloatArray],
) -> FloatArray:
    """Minimise ``Dbar s + eps t`` with ``t >= integral |c'g|``, ``s >= integral |v'g|``."""
    nodes, _, k = responses.shape
    rows = [problem.model.output_vector, *directions]
    count = k + 2 + nodes * len(rows)
    cost = np.zeros(count)
    cost[k : k + 2] = problem.mean_luminosity, problem.tolerance
    blocks: list[scipy.sparse.csr_array] = []
    limits: list[FloatArray] = []
    eye = scipy.sparse.eye_array(nodes, format='csr')
    for index, row in enumerate(rows):
        affine = scipy.sparse.csr_array(np.einsum('ijk,j->ik', responses, row))
        before = scipy.sparse.csr_array((nodes, 2 + nodes * index))
        after = scipy.sparse.csr_array((nodes, nodes * (len(rows) - 1 - index)))
        for sign in (1.0, -1.0):
            blocks.append(scipy.sparse.hstack([sign * affine, before, -eye, after]))
            limits.append(-sign * (nominal @ row))
        total = np.zeros((1, count))
        total[0, k + 2 + nodes * index : k + 2 + nodes * (index + 1)] = weights
        total[0, k + 1 if index == 0 else k] = -1.0
        blocks.append(scipy.sparse.csr_array(total))
        limits.append(np.zeros(1))
    result = scipy.optimize.linprog(
        cost,
        A_ub=scipy.sparse.vstack(blocks).tocsr(),
        b_ub=np.concatenate(limits),
        bounds=[(None, None)] * k + [(0, None)] * (count - k),
        method='highs',
    )
    if result.x is None:
        raise SynthesisError(
            Assumption.CONFIRMATION,
            f'the linear program of the L1 design failed: {result.message}',
        )
    return np.asarray(result.x[:k], dtype=np.float64)


def _objective(problem: DesignProblem, controller: LinearController) -> float:
    gains = peak_gains(
        state_response(problem.model, controller),
        problem.model.output_vector,
        rtol=_COMPARISON_RTOL,
    )
    return gains.state * problem.mean_luminosity + gains.output * problem.tolerance
