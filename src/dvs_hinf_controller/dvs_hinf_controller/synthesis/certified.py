"""Maximise the certified threshold: peak-to-peak (L1) design by linear programming."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy.optimize
import scipy.sparse

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.directions import WeightedVectors, steepest_direction
from dvs_hinf_controller.analysis.kernel import trapezoidal_weights
from dvs_hinf_controller.analysis.peak_gain import peak_gains
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.order_reduction import reduced_controllers
from dvs_hinf_controller.synthesis.rolled_off import synthesize_unstructured
from dvs_hinf_controller.synthesis.structured import synthesize_structured
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError
from dvs_hinf_controller.synthesis.units import Units, plant_rate
from dvs_hinf_controller.synthesis.youla import YoulaFamily

# Filter poles: an octave apart, up to this multiple of the plant's own rate.
_FASTEST_FILTER = 100.0
_MAX_FILTERS = 9
_OBSERVER_RATES = (0.03, 4.0)
_MAX_CUTS = 6
_SOLVERS = ('highs', 'highs-ipm')
_CUT_RTOL = 2e-3
_REDUCTION_LOSS = 2e-3
_COMPARISON_RTOL = 1e-3


def synthesize_certified(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Controller with (nearly) the largest h_certified.

    Minimises ``N_G Dbar + eps N_T``, a convex function of the closed loop (Dahleh and Pearson
    1987), over Youla families whose filters are no faster than the bandwidth limit; then takes the
    lowest order that loses next to nothing. The controllers of the other methods are candidates.

    Parameters
    ----------
    problem
        Plant, luminosities and tolerance.
    options
        Bandwidth limit; slack and process noise of the other methods.

    Raises
    ------
    SynthesisError
        If no method finds a controller; with the reason of the first.
    """
    units = Units.of_problem(problem)
    plant, limits = units.plant(problem.model), units.options(options)
    sources: list[Callable[[], LinearController]] = [
        lambda: synthesize_unstructured(problem.model, options),
        lambda: synthesize_structured(problem.model, options),
    ]
    sources += [
        lambda rate=rate: units.controller(peak_to_peak(plant, limits, rate))  # type: ignore[misc]
        for rate in _OBSERVER_RATES
    ]
    candidates, failures = [], []
    for source in sources:
        try:
            candidates.append(source())
        except (SynthesisError, np.linalg.LinAlgError) as error:
            failures.append(error)
    if not candidates:
        raise failures[0]
    best = min(candidates, key=lambda k: _objective(problem, k))
    return _of_low_order(problem, best)


def _of_low_order(problem: DesignProblem, controller: LinearController) -> LinearController:
    least = _objective(problem, controller)
    if not math.isfinite(least):
        return controller
    limit = least * (1 + _REDUCTION_LOSS)
    try:
        truncations = reduced_controllers(problem.model, controller)
    except np.linalg.LinAlgError:
        return controller
    for candidate in truncations:
        if _objective(problem, candidate) <= limit:
            return candidate
    return controller


def peak_to_peak(
    plant: PlantModel, options: DesignOptions, observer_rate: float
) -> LinearController:
    """Controller with the least ``N_G + N_T`` of a Youla family.

    Parameters
    ----------
    plant
        Plant in the units of the problem: tolerance and mean luminosity are 1.
    options
        Bandwidth limit, in the same units.
    observer_rate
        Rate of the family's observer, relative to the plant's.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable, or the linear program has no solution.
    """
    family = YoulaFamily.around_observer(
        plant, _filter_poles(plant, options), rate=observer_rate * plant_rate(plant)
    )
    return family.controller(_optimal_coefficients(family))


def _filter_poles(model: PlantModel, options: DesignOptions) -> FloatArray:
    rate = plant_rate(model)
    fastest = _FASTEST_FILTER * rate
    if options.bandwidth_limit > 0:
        fastest = min(fastest, options.bandwidth_limit)
    modes = np.linalg.eigvals(model.state_matrix)
    unstable = np.abs(modes[modes.real > 1e-9 * rate])
    slowest = min(max(float(np.min(unstable, initial=rate)), 0.1 * rate), fastest / 2)
    count = min(_MAX_FILTERS, 1 + math.ceil(math.log2(fastest / slowest)))
    return np.asarray(np.geomspace(slowest, fastest, count))


def _optimal_coefficients(family: YoulaFamily) -> FloatArray:
    """Cutting planes: a direction v enters once ``integral |v'g|`` exceeds what is accounted."""
    times = family.time_grid()
    with np.errstate(over='ignore', invalid='ignore'):  # refused by the linear program
        nominal, responses = family.responses(times)
    weights = trapezoidal_weights(times)
    sizes = np.sum(weights[:, None, None] * np.abs(responses), axis=(0, 1)) + 1e-300
    responses = responses / sizes
    theta = np.zeros(family.coefficient_count)
    directions: list[FloatArray] = []
    for _ in range(_MAX_CUTS):
        kernel = WeightedVectors(values=nominal + responses @ theta, weights=weights)
        v = steepest_direction(kernel)
        worst = float(kernel.integral(v[:, None])[0])
        accounted = max(
            (float(kernel.integral(known[:, None])[0]) for known in directions), default=0.0
        )
        if worst <= accounted * (1 + _CUT_RTOL):
            break
        directions.append(v)
        rows = [family.model.output_vector, *directions]
        theta = _linear_program(rows, weights, nominal, responses)
    return np.asarray(theta / sizes)


def _linear_program(
    rows: list[FloatArray], weights: FloatArray, nominal: FloatArray, responses: FloatArray
) -> FloatArray:
    """Minimise ``s + t`` with ``t >= integral |c'g|``, ``s >= integral |v'g|``.

    Every entry of the kernels is split into its positive and its negative part.
    """
    nodes, _, k = responses.shape
    parts = nodes * len(rows)
    scale = 1 / max(float(weights @ np.linalg.norm(nominal, axis=1)), 1e-300)
    affine = np.vstack([np.einsum('ijk,j->ik', responses, row) for row in rows])
    fixed = np.concatenate([nominal @ row for row in rows]) * scale
    eye = scipy.sparse.eye_array(parts, format='csr')
    equalities = scipy.sparse.hstack(
        [scipy.sparse.csr_array(affine), scipy.sparse.csr_array((parts, 2)), -eye, eye]
    )
    totals = np.zeros((len(rows), k + 2 + 2 * parts))
    for index in range(len(rows)):
        totals[index, k + 1 if index == 0 else k] = -1.0
        for start in (k + 2, k + 2 + parts):
            totals[index, start + nodes * index : start + nodes * (index + 1)] = weights
    cost = np.zeros(k + 2 + 2 * parts)
    cost[k : k + 2] = 1.0
    message = 'the responses of its family exceed the range of numbers'
    for solver in _SOLVERS if np.isfinite(affine).all() and np.isfinite(fixed).all() else ():
        result = scipy.optimize.linprog(
            cost,
            A_ub=scipy.sparse.csr_array(totals),
            b_ub=np.zeros(len(rows)),
            A_eq=equalities.tocsr(),
            b_eq=-fixed,
            bounds=[(None, None)] * k + [(0, None)] * (2 + 2 * parts),
            method=solver,
        )
        if result.x is not None:
            return np.asarray(result.x[:k] / scale, dtype=np.float64)
        message = result.message
    raise SynthesisError(
        Assumption.CONFIRMATION, f'the linear program of the L1 design failed: {message}'
    )


def _objective(problem: DesignProblem, controller: LinearController) -> float:
    gains = peak_gains(
        state_response(problem.model, controller),
        problem.model.output_vector,
        rtol=_COMPARISON_RTOL,
    )
    return gains.state * problem.mean_luminosity + gains.output * problem.tolerance
