"""Random plants with designed controllers, bright enough to be seen by a logarithmic pixel."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.peak_gain import peak_gains
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import DesignFigures, design_controller, measure
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError

METHODS = ('structured', 'unstructured', 'lqg')


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomCase:
    """A plant, its problem and a controller with a positive certified threshold.

    Parameters
    ----------
    problem
        Plant, set-point, pixels, tolerance.
    controller
        K.
    method
        How K was found.
    figures
        What K promises.
    uncertainty
        Relative half-width of the reference bounds around the first luminosity.
    """

    problem: DesignProblem
    controller: LinearController
    method: str
    figures: DesignFigures
    uncertainty: float


def random_case(
    seed: int, method: str, *, accept: Callable[[RandomCase], bool] = lambda case: True
) -> RandomCase:
    """Draw cases until one has a certified threshold.

    The tolerance is chosen so that the certificate allows a drawn relative error of the estimate;
    drawn freely, it would nearly always be met trivially or not at all.

    Parameters
    ----------
    seed
        Seed of everything random.
    method
        One of `METHODS`, or `certified`.
    accept
        Whether a case will do.
    """
    rng = np.random.default_rng(seed)
    while True:
        case = _attempt(rng, method)
        if case is not None and accept(case):
            return case


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomProblem:
    """A plant seen by a few bright pixels, with a tolerance of 1 for lack of a better one.

    Parameters
    ----------
    problem
        Plant, set-point, pixels.
    uncertainty
        Relative half-width of the reference bounds around the first luminosity.
    """

    problem: DesignProblem
    uncertainty: float


def random_problem(rng: np.random.Generator) -> RandomProblem:
    """Draw a problem.

    Parameters
    ----------
    rng
        Source of randomness.
    """
    model = _plant(rng)
    held = model.equilibrium(rng.uniform(-1, 1, model.state_count), tolerance=np.inf)
    pixels = int(rng.choice([1, 2, 3, 5, 9]))
    darkest = float(10.0 ** rng.uniform(-1, 1))
    target = float(model.gradient @ held.state)
    offsets = darkest * (1 + rng.uniform(0, 0.5, pixels)) - target
    uncertainty = float(rng.choice([0.0, 0.01]))
    luminosity = target + offsets
    problem = DesignProblem(
        model=model,
        equilibrium=held,
        scene=PixelScene(brightness_offsets=offsets, height=1, width=pixels),
        bounds=ReferenceBounds(
            lower=luminosity * (1 - uncertainty), upper=luminosity * (1 + uncertainty)
        ),
        tolerance=1.0,
        log_base=float(rng.choice([2.0, math.e, 10.0])),
    )
    return RandomProblem(problem=problem, uncertainty=uncertainty)


def _attempt(rng: np.random.Generator, method: str) -> RandomCase | None:
    drawn = random_problem(rng)
    problem, uncertainty = drawn.problem, drawn.uncertainty
    model = problem.model
    try:
        model.require_stabilizable()
        model.require_detectable()
        controller = _controller(problem, method, rng)
        gains = peak_gains(state_response(model, controller), model.gradient)
        if not 0 < gains.output < 12:
            return None
        allowed = float(rng.uniform(0.3, 0.9)) / gains.output
        tolerance = allowed * gains.state * problem.mean_luminosity / (1 - allowed * gains.output)
        problem = replace(problem, tolerance=tolerance)
        figures = measure(problem, controller)
    except (SynthesisError, ValueError, np.linalg.LinAlgError):
        return None
    if not 0.005 < figures.h_certified < np.inf or figures.closed_loop_abscissa > -1e-2:
        return None
    return RandomCase(
        problem=problem,
        controller=controller,
        method=method,
        figures=figures,
        uncertainty=uncertainty,
    )


def _plant(rng: np.random.Generator) -> PlantModel:
    """One to four states, one or two inputs, poles from -4 to +2."""
    n = int(rng.integers(1, 5))
    m = int(rng.integers(1, min(n, 2) + 1))
    a = rng.standard_normal((n, n))
    a += (rng.uniform(0.2, 2.0) - np.max(np.linalg.eigvals(a).real)) * np.eye(n)
    c = rng.standard_normal(n)
    return PlantModel(
        state_matrix=a,
        input_matrix=rng.standard_normal((n, m)),
        output_vector=c / np.linalg.norm(c),
    )


def _controller(problem: DesignProblem, method: str, rng: np.random.Generator) -> LinearController:
    if method == 'lqg':
        return lqg_controller(problem.model, *(10.0 ** rng.uniform(-2, 0, 2)))
    return design_controller(problem, method=method).controller


def lqg_controller(model: PlantModel, cost: float, noise: float) -> LinearController:
    """LQG controller with unit weights on the states.

    Parameters
    ----------
    model
        Plant.
    cost
        Weight of ``||u||^2``.
    noise
        Intensity of the measurement noise beside unit process noise.
    """
    a, b, c = model.state_matrix, model.input_matrix, model.gradient[:, None]
    n, m = b.shape
    p = scipy.linalg.solve_continuous_are(a, b, np.eye(n), cost * np.eye(m))
    s = scipy.linalg.solve_continuous_are(a.T, c, np.eye(n), noise * np.eye(1))
    gain, filter_gain = b.T @ p / cost, s @ c / noise
    return LinearController(
        state_matrix=a - b @ gain - filter_gain @ c.T,
        input_vector=filter_gain[:, 0],
        output_matrix=-gain,
        feedthrough=np.zeros(m),
    )
