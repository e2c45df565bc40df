"""Study `promise`: no run of the sampled loop within what was promised may leave the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.promise import Promise, sectors_at
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import design_controller
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError
from dvs_simulation.sampled.late_loop import TICKS, LateRun, run_late
from dvs_simulation.sweep.random_loops import lqg_controller, random_problem
from dvs_simulation.sweep.study import Row, Study, Task

COLUMNS = (
    'seed',
    'method',
    'states',
    'inputs',
    'pixels',
    'period',
    'latency',
    'jitter',
    'model_uncertainty',
    'disturbance',
    'h_certified',
    'tolerance',
    'limsup',
    'ratio',
)
METHODS = ('lqg', 'unstructured', 'lqg', 'structured')
_CONSTANTS, _TAIL_SHARE, _MOST_SAMPLES, _LEAST_SAMPLES = 14.0, 0.4, 6000, 400


@dataclass(frozen=True, slots=True, kw_only=True)
class PromiseCase:
    """A problem whose tolerance is what its controller holds at the drawn threshold.

    Parameters
    ----------
    problem
        With an operation, and the tolerance that `h_certified` holds.
    controller
        K.
    method
        How K was found.
    h_certified
        Threshold.
    uncertainty
        Relative half-width of the bounds of the references.
    abscissa
        Largest real part of a closed-loop pole, 1/s.
    """

    problem: DesignProblem
    controller: LinearController
    method: str
    h_certified: float
    uncertainty: float
    abscissa: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PromiseSummary:
    """Outcome of the study.

    Parameters
    ----------
    runs
        Runs with light to their end.
    plants
        Different plants among them.
    violations
        Runs that left the tolerance.
    tightest
        Largest ``limsup / eps``.
    dark
        Runs that a dark pixel ended.
    """

    runs: int
    plants: int
    violations: int
    tightest: float
    dark: int


def promise_study(*, plants: int = 220, runs: int = 500, seed: int = 0) -> Study:
    """Study over `plants` random plants with `runs` adversarial runs each, at h = h_certified.

    Parameters
    ----------
    plants
        Number of plants.
    runs
        Runs of each: starts, references, disturbances, latencies and plants within the promise.
    seed
        Seed of everything.
    """
    tasks = [
        Task(
            key=f'plant-{i}',
            parameters={
                'seed': seed * 1_000_003 + i,
                'method': METHODS[i % len(METHODS)],
                'runs': runs,
            },
            rows=runs,
        )
        for i in range(plants)
    ]
    return Study(
        name='promise',
        columns=COLUMNS,
        function=run_promise_task,
        tasks=tasks,
        options={'plants': plants, 'runs': runs, 'seed': seed},
    )


def run_promise_task(*, seed: int, method: str, runs: int) -> list[Row]:
    """Rows of one plant.

    Parameters
    ----------
    seed
        Seed of the plant and of its runs.
    method
        How the controller is found.
    runs
        Number of runs.
    """
    rng = np.random.default_rng([seed, 7])
    case = None
    while case is None:
        case = _attempt(rng, method)
    return [_row(seed, case, _adversarial_run(case, rng)) for _ in range(runs)]


def _attempt(rng: np.random.Generator, method: str) -> PromiseCase | None:
    drawn = random_problem(rng)
    problem, model = drawn.problem, drawn.problem.model
    try:
        model.require_stabilizable()
        model.require_detectable()
        if method == 'lqg':
            controller = lqg_controller(model, *(10.0 ** rng.uniform(-2, 0, 2)))
        else:
            controller = design_controller(problem, method=method).controller
    except (SynthesisError, ValueError, np.linalg.LinAlgError):
        return None
    poles = np.linalg.eigvals(controller.state_matrix)
    vectors = np.linalg.eig(controller.state_matrix)[1]
    abscissa = float(np.max(state_response(model, controller).poles().real))
    if np.linalg.cond(vectors) > 1e6 or np.min(np.abs(poles)) < 1e-6 or abscissa > -0.05:
        return None
    period = float(10.0 ** rng.uniform(-3, -1.3)) / max(1.0, -abscissa)
    if _CONSTANTS / -abscissa / period > _MOST_SAMPLES:
        return None
    late = int(rng.choice([0, 0, TICKS // 4, TICKS, 30]))
    jitter = int(rng.choice([0, 1, 3])) if late else 0
    light = float(np.min(np.abs(problem.set_point_luminosity)))
    scale = light / float(np.linalg.norm(model.output_vector))
    strength = scale / max(float(np.linalg.norm(model.input_matrix)), 1e-9)
    operation = Operation(
        sampling_period=period,
        latency=late * period / TICKS,
        latency_jitter=jitter * period / TICKS,
        disturbance_bound=np.full(
            model.input_count, float(rng.choice([0.0, 0.01, 0.1])) * strength
        ),
        model_uncertainty=float(rng.choice([0.0, 0.003, 0.02])),
    )
    problem = replace(problem, operation=operation)
    threshold = float(10.0 ** rng.uniform(-3, -0.7))
    held = Promise(problem, controller, operation).held(sectors_at(problem, threshold))
    if not 0 < held.error < math.inf:
        return None
    return PromiseCase(
        problem=replace(problem, tolerance=held.error),
        controller=controller,
        method=method,
        h_certified=threshold,
        uncertainty=drawn.uncertainty,
        abscissa=abscissa,
    )


def _adversarial_run(case: PromiseCase, rng: np.random.Generator) -> FloatArray:
    """Deviations of a run whose every freedom is used against it."""
    problem, operation = case.problem, case.problem.operation
    assert operation is not None
    model, period = problem.model, operation.sampling_period
    samples = math.ceil(_CONSTANTS / -case.abscissa / period)
    samples = max(samples, _LEAST_SAMPLES)
    direction = rng.standard_normal(model.state_count)
    direction /= np.linalg.norm(direction)
    room = float(np.min(problem.set_point_luminosity)) / float(np.linalg.norm(model.output_vector))
    deviation = direction * min(problem.tolerance, 0.3 * room) * rng.uniform(0, 1)
    y = problem.scene.luminosity(model, problem.equilibrium.state + deviation)
    c = case.uncertainty
    bounds = ReferenceBounds(lower=y * (1 - c), upper=y * (1 + c))
    step = case.h_certified * math.log(problem.log_base)
    spread = np.exp(rng.choice([-1.0, 1.0, 0.3], y.size) * 0.999 * step)
    centre = round(operation.latency / period * TICKS)
    jitter = round(operation.latency_jitter / period * TICKS)
    late = centre + jitter * rng.choice([-1, 1], samples)
    if rng.random() < 0.3:
        late = centre + np.broadcast_to(jitter * rng.choice([-1, 1]), (samples,))
    wave = max(int(samples * TICKS * 10.0 ** rng.uniform(-3, 0)), 1)
    signs = np.where((np.arange(samples * TICKS) // wave) % 2 == 0, 1.0, -1.0)
    push = signs[:, None] * operation.disturbance_bound * rng.choice([-1, 1], model.input_count)
    greedy = np.zeros((model.input_count, model.state_count))
    if rng.random() < 0.5:
        greedy = rng.choice([-1, 1]) * (model.input_matrix.T @ _lyapunov(case))
    return run_late(
        replace(problem, bounds=bounds),
        case.controller,
        LateRun(
            plant=_in_error(model, operation.model_uncertainty, rng),
            deviation=deviation,
            first_reference=np.clip(y * spread, bounds.lower, bounds.upper),
            event_threshold=case.h_certified,
            latencies=late.astype(np.int64),
            disturbance=push,
            greedy=greedy,
        ),
    )


def _lyapunov(case: PromiseCase) -> FloatArray:
    g = state_response(case.problem.model, case.controller)
    n = case.problem.model.state_count
    p = scipy.linalg.solve_continuous_lyapunov(g.a.T, -g.c.T @ g.c)
    return np.asarray(p[:n, :n])


def _in_error(model: PlantModel, size: float, rng: np.random.Generator) -> PlantModel:
    a, b = (
        matrix * (1 + size * rng.choice([-1.0, 1.0], matrix.shape))
        for matrix in (model.state_matrix, model.input_matrix)
    )
    return replace(model, state_matrix=a, input_matrix=b)


def _row(seed: int, case: PromiseCase, path: FloatArray) -> Row:
    operation, model = case.problem.operation, case.problem.model
    assert operation is not None
    tail = path[int(len(path) * (1 - _TAIL_SHARE)) :]
    limsup = float(np.linalg.norm(tail, axis=1).max())
    return {
        'seed': seed,
        'method': case.method,
        'states': model.state_count,
        'inputs': model.input_count,
        'pixels': case.problem.scene.pixel_count,
        'period': operation.sampling_period,
        'latency': operation.latency,
        'jitter': operation.latency_jitter,
        'model_uncertainty': operation.model_uncertainty,
        'disturbance': float(operation.disturbance_bound.max()),
        'h_certified': case.h_certified,
        'tolerance': case.problem.tolerance,
        'limsup': limsup,
        'ratio': limsup / case.problem.tolerance,
    }


def summarize_promise(rows: list[dict[str, str]]) -> PromiseSummary:
    """Figures of the study.

    Parameters
    ----------
    rows
        Rows of its table.
    """
    ratios = np.array([float(row['ratio']) for row in rows])
    lit = np.isfinite(ratios)
    return PromiseSummary(
        runs=int(lit.sum()),
        plants=len({row['seed'] for row, is_lit in zip(rows, lit, strict=True) if is_lit}),
        violations=int(np.sum(ratios[lit] > 1 + 1e-9)),
        tightest=float(ratios[lit].max(initial=0.0)),
        dark=int(np.sum(~lit)),
    )
