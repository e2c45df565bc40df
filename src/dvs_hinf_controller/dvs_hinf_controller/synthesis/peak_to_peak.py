"""Controllers with the least peak-to-peak gains of a Youla family."""

from __future__ import annotations

import math

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.directions import WeightedVectors, steep_directions
from dvs_hinf_controller.analysis.flows import trapezoidal_weights
from dvs_hinf_controller.analysis.plant_rates import plant_rate
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.synthesis.delayed_plant import delayed_plant
from dvs_hinf_controller.synthesis.least_l1 import L1Problem, least_l1
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError
from dvs_hinf_controller.synthesis.youla import Filters, Jump, YoulaFamily

# How many real poles at most, an octave apart or more; the slowest over the plant's own rate.
_FEW_FILTERS, _MANY_FILTERS = 9, 12
_SLOWEST_FILTER = 0.1
# A chain of integrators has no rate of its own: the slower its loop the better.
_STILL, _SLOWEST_OF_CHAINS, _MOST_FILTERS = 1e-3, 3e-4, 24
# Corners of damped pairs over the plant's own rate.
_PAIRS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_DAMPING = 0.5
# Damping below which a mode of the plant is a filter, too: it is cheaper to keep than to damp.
_LIGHT = 0.1
_MAX_CUTS = 12
_CUT_WORK = 6e7
_CUT_RTOL = 5e-3
_COUNTED = 0.9


def peak_to_peak(
    plant: PlantModel,
    *,
    observer_rate: float,
    filters: Filters,
    delay: float = 0.0,
    strictly_proper: bool = False,
    directions: list[FloatArray] | None = None,
) -> LinearController:
    """Controller with the least ``N_G + N_T`` of a Youla family.

    Parameters
    ----------
    plant
        Plant in the units of the problem: tolerance and mean luminosity are 1.
    observer_rate
        Rate of the family's observer, relative to the plant's or to the fastest filter's.
    filters
        Filters of the family.
    delay
        Delay of the commands; 0 for none.
    strictly_proper
        Whether the controller must have no feedthrough.
    directions
        Directions of the state in which another family's kernel was large: to begin with. Those
        of this family are put in their place.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable, or rounding stops the program.
    """
    rate = min(plant_rate(plant), filters.fastest)
    family = YoulaFamily.around_observer(
        delayed_plant(plant, delay) if delay > 0 else plant,
        filters,
        rate=observer_rate * rate,
        strictly_proper=strictly_proper,
    )
    known = [] if directions is None else directions
    return family.controller(_optimal_coefficients(family, plant.state_count, known))


def family_filters(plant: PlantModel, fastest: float, *, rich: bool, patient: bool) -> Filters:
    """Filters with real poles an octave apart; rich ones are slower, too, and some damped.

    Parameters
    ----------
    plant
        Plant in the units of the problem.
    fastest
        Largest pole.
    rich
        Whether slower real poles, damped pairs and the plant's own lightly damped modes are among
        them.
    patient
        Whether a chain of integrators, which has no rate of its own, gets ever slower ones.
    """
    rate = min(plant_rate(plant), fastest)
    modes = np.linalg.eigvals(plant.state_matrix)
    if not rich:
        unstable = np.abs(modes[modes.real > 1e-9 * rate])
        slowest = min(max(float(np.min(unstable, initial=rate)), 0.1 * rate), fastest / 2)
        return Filters.of(_octaves(slowest, fastest, _FEW_FILTERS))
    if patient and np.abs(modes).max() < _STILL * rate:
        return Filters.of(_octaves(_SLOWEST_OF_CHAINS * rate, fastest, _MOST_FILTERS))
    corners = rate * np.array(_PAIRS)
    swinging = (modes.imag > 0) & (modes.real < 0) & (-modes.real < _LIGHT * modes.imag)
    damped = corners[corners <= fastest] * complex(-_DAMPING, math.sqrt(1 - _DAMPING**2))
    return Filters.of(
        _octaves(_SLOWEST_FILTER * rate, fastest, _MANY_FILTERS),
        np.concatenate([damped, modes[swinging]]),
    )


def _octaves(slowest: float, fastest: float, most: int) -> FloatArray:
    count = min(most, 1 + math.ceil(math.log2(fastest / slowest)))
    return np.asarray(np.geomspace(slowest, fastest, count))


def _optimal_coefficients(
    family: YoulaFamily, states: int, directions: list[FloatArray]
) -> FloatArray:
    """Cutting planes: a direction v enters once ``integral |v'g|`` exceeds what is accounted.

    The directions that count at the optimum are left in `directions`.
    """
    times = family.time_grid()
    with np.errstate(over='ignore', invalid='ignore'):
        nominal, responses = family.responses(times)
    nominal, responses = nominal[:, :states], responses[:, :states]
    if not (np.isfinite(nominal).all() and np.isfinite(responses).all()):
        raise SynthesisError(Assumption.CONFIRMATION, 'the responses exceed the range of numbers')
    weights = trapezoidal_weights(times)
    sizes = np.sum(weights[:, None, None] * np.abs(responses), axis=(0, 1)) + 1e-300
    responses = responses / sizes
    jump = family.jump(sizes)
    best, least = np.zeros(family.coefficient_count), math.inf
    cost, spent = times.size * family.coefficient_count**2, 0.0
    for _ in range(_MAX_CUTS):
        theta = np.zeros(family.coefficient_count)
        if directions:
            rows = [family.model.gradient[:states], *directions]
            theta = _least(rows, weights, nominal, responses, jump)
        kernel = WeightedVectors(values=nominal + responses @ theta, weights=weights)
        steep = steep_directions(kernel)
        integrals = kernel.integral(steep)
        output = float(kernel.integral(family.model.gradient[:states, None])[0])
        accounted = max((float(kernel.integral(v[:, None])[0]) for v in directions), default=0.0)
        if directions and integrals[0] + output < least:
            best, least = theta, integrals[0] + output
        spent += cost * (1 + len(directions))
        if integrals[0] <= accounted * (1 + _CUT_RTOL) or spent > _CUT_WORK:
            break
        high = integrals > max(accounted * (1 + _CUT_RTOL), _COUNTED * integrals[0])
        directions += list(steep[:, high].T)
    counted = [float(kernel.integral(v[:, None])[0]) >= _COUNTED * accounted for v in directions]
    directions[:] = [v for v, counts in zip(directions, counted, strict=True) if counts]
    return np.asarray(best / sizes)


def _least(
    rows: list[FloatArray],
    weights: FloatArray,
    nominal: FloatArray,
    responses: FloatArray,
    jump: Jump,
) -> FloatArray:
    """Minimise ``integral |c'g| + max_v integral |v'g|``: c comes first."""
    seen = np.array(rows)
    scale = 1 / max(float(weights @ np.linalg.norm(nominal, axis=1)), 1e-300)
    program = L1Problem(
        slopes=np.ascontiguousarray(np.einsum('ijk,rj->rik', responses, seen)),
        offsets=np.einsum('ij,rj->ri', nominal, seen) * scale,
        weights=weights,
        equal_slope=jump.slope,
        equal_offset=jump.offset * scale,
    )
    return least_l1(program) / scale
