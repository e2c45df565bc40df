"""Minimise mu = sup_w (|T| + ||G||) by D-K iteration with one scalar D-scale."""

from __future__ import annotations

import math

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.mu import log_grid, mu_bounds
from dvs_hinf_controller.analysis.plant_rates import plant_rate
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import ComplexArray, state_response
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import synthesize_rolled_off
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError
from dvs_hinf_controller.synthesis.units import Units
from dvs_hinf_controller.synthesis.weight_fit import fit_magnitude

_MAX_ITERATIONS = 8
_STAGNATION = 1e-3
_LEAST_RATIO = 0.02
# Luminosity a unit of state beyond which |T| outweighs ||G|| more than double precision bears.
_LARGEST_SLOPE = 300.0


def synthesize_structured(model: PlantModel, options: DesignOptions) -> LinearController:
    """Controller of (nearly) the least mu (Packard and Doyle 1993; docs/theory.md).

    One input: G/T does not depend on the controller, so the best scale is known in advance and one
    weighted H-infinity synthesis ends the iteration. More inputs: D-K iteration from the
    unstructured controller; the best iterate is kept, and stagnation ends it.

    Parameters
    ----------
    model
        Plant.
    options
        Slack, bandwidth limit, process noise.

    Raises
    ------
    SynthesisError
        If the unweighted problem has no controller; names the assumption that fails.
    """
    model.require_one_group('method structured')
    units = Units.of(model)
    plant, limits = units.plant(model), units.options(options)
    slope = min(units.luminosity, _LARGEST_SLOPE)
    if model.input_count == 1:
        return units.controller(_one_input(plant, limits, slope))
    best = units.controller(synthesize_rolled_off(plant, limits).controller)
    best_mu = current_mu = _mu(model, best)
    controller = best
    for _ in range(_MAX_ITERATIONS):
        response = _response(model, units, controller)
        try:
            iterate = _next_iterate(plant, response, limits, slope)
        except SynthesisError:
            break
        controller = units.controller(iterate)
        previous_mu, current_mu = current_mu, _mu(model, controller)
        if current_mu < best_mu:
            best, best_mu = controller, current_mu
        if current_mu > previous_mu * (1 - _STAGNATION):
            break
    return best


def input_ratio(model: PlantModel, frequencies: FloatArray) -> FloatArray:
    """``|T| / ||G||`` at every frequency where one input leaves it no choice, shape (f,).

    Parameters
    ----------
    model
        Plant with one input.
    frequencies
        w > 0, shape (f,), rad/s, off the plant's own poles.
    """
    identity = np.eye(model.state_count)
    pencil = 1j * frequencies[:, None, None] * identity - model.state_matrix
    right = np.broadcast_to(model.input_matrix, (frequencies.size, *model.input_matrix.shape))
    direction = np.linalg.solve(pencil, right)[:, :, 0]
    return np.asarray(np.abs(direction @ model.gradient) / np.linalg.norm(direction, axis=1))


def _one_input(plant: PlantModel, options: DesignOptions, luminosity: float) -> LinearController:
    grid = _grid(plant)
    fit = fit_magnitude(grid, 1 + luminosity * input_ratio(plant, grid))
    return synthesize_rolled_off(plant, options, weight=fit.weight).controller


def _response(model: PlantModel, units: Units, controller: LinearController) -> ComplexArray:
    """G of the user's plant on the grid of the plant in `units`, shape (f, n)."""
    frequencies = _grid(units.plant(model)) * units.rate
    return np.asarray(state_response(model, controller).response(frequencies)[:, :, 0])


def _next_iterate(
    plant: PlantModel, response: ComplexArray, options: DesignOptions, luminosity: float
) -> LinearController:
    grid = _grid(plant)
    ratio = np.abs(response @ plant.gradient) / np.linalg.norm(response, axis=1)
    inverse_square = luminosity * np.maximum(ratio, _LEAST_RATIO)
    return synthesize_rolled_off(
        plant,
        options,
        weight=fit_magnitude(grid, np.sqrt(1 + inverse_square)).weight,
        output_weight=fit_magnitude(grid, np.sqrt(1 + luminosity**2 / inverse_square)).weight,
    ).controller


def _mu(model: PlantModel, controller: LinearController) -> float:
    return mu_bounds(state_response(model, controller), model.gradient, rtol=1e-2).upper


def _grid(model: PlantModel) -> FloatArray:
    rate = plant_rate(model)
    modes = np.append(np.linalg.eigvals(model.state_matrix), [rate, rate / 10])
    return log_grid(modes, points_per_decade=20)[1:] * math.exp(1e-3)
