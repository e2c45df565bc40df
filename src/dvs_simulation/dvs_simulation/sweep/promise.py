"""Study `promise`: no run of the sampled loop within what was promised may leave the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.largest_threshold import held_at
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, Timing
from dvs_hinf_controller.analysis.promise import Promise
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.certification import held_from
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.methods import synthesis_method
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError
from dvs_simulation.judging.measures import kept, regulated, size_of
from dvs_simulation.sampled.late_loop import TICKS, LateRun, run_late
from dvs_simulation.sweep.adversary import Adversary, Freedom, in_error, largest_start
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
    'settled',
    'light_promised',
)
METHODS = ('certified', 'lqg', 'certified', 'unstructured', 'certified', 'structured')
_CONSTANTS, _MOST_SAMPLES, _LEAST_SAMPLES = 14.0, 3000, 400
# A run outside the tolerance that still falls from fifth to fifth by this share goes on, twice as
# long each time: the true plant may be slower than the nominal one.
_FALLING, _CONTINUATIONS = 0.99, 5
# A threshold at which nothing is held is divided by ten, this often.
_FALLS, _RTOL = 3, 1e-3
# Share of the runs that vary the worst so far instead of starting afresh.
_VARIED = 0.6


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
        Decay of the slowest mode of the loop that runs, held and late, 1/s; negative.
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
        Runs with positive luminosities to their end.
    plants
        Different plants among them.
    violations
        Runs that had settled outside the tolerance.
    tightest
        Largest ``limsup / eps`` of a settled run.
    dark
        Runs that ended at a luminosity that is not positive.
    dark_though_promised
        Those of them for which positive luminosities were promised from the start.
    unsettled
        Runs that were outside the tolerance and still falling when they ended.
    """

    runs: int
    plants: int
    violations: int
    tightest: float
    dark: int
    dark_though_promised: int
    unsettled: int


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
    return _runs(seed, case, runs, rng)


def _runs(seed: int, case: PromiseCase, runs: int, rng: np.random.Generator) -> list[Row]:
    """Runs of one case, each with a drawn freedom or a variation of the worst one so far."""
    problem, operation = case.problem, case.problem.operation
    assert operation is not None
    samples = math.ceil(_CONSTANTS / -case.abscissa / operation.sampling_period)
    adversary = Adversary(
        problem,
        case.controller,
        samples=max(samples, _LEAST_SAMPLES),
        period=operation.sampling_period,
    )
    rows: list[Row] = []
    worst, worst_ratio = adversary.draw(rng), -math.inf
    for _ in range(runs):
        freedom = adversary.draw(rng)
        if rng.random() < _VARIED:
            freedom = worst.mixed(freedom, rng)
        row = _row(seed, case, freedom)
        if row['settled'] and row['ratio'] > worst_ratio:
            worst, worst_ratio = freedom, row['ratio']
        rows.append(row)
    return rows


def _attempt(rng: np.random.Generator, method: str) -> PromiseCase | None:
    drawn = random_problem(rng)
    problem, model = drawn.problem, drawn.problem.model
    period = float(10.0 ** rng.uniform(-2.3, -1.3))
    try:
        model.require_stabilizable()
        model.require_detectable()
        if method == 'lqg':
            controller = lqg_controller(model, *(10.0 ** rng.uniform(-2, 0, 2)))
        else:
            designed = replace(problem, operation=Operation(sampling_period=period))
            controller = synthesis_method(method).synthesize(designed, DesignOptions())
    except (SynthesisError, ValueError, np.linalg.LinAlgError):
        return None
    poles = np.linalg.eigvals(controller.state_matrix)
    vectors = np.linalg.eig(controller.state_matrix)[1]
    abscissa = float(np.max(state_response(model, controller).poles().real))
    if np.any(controller.feedthrough) or abscissa > -0.05:
        return None
    if np.linalg.cond(vectors) > 1e6 or np.min(np.abs(poles)) < 1e-6:
        return None
    if _CONSTANTS / -abscissa / period > _MOST_SAMPLES:
        return None
    late = int(rng.choice([0, 0, TICKS // 4, TICKS, 30]))
    jitter = int(rng.choice([0, 1, 3])) if late else 0
    light = float(np.min(np.abs(problem.set_point_luminosity)))
    scale = light / float(np.linalg.norm(model.gradient))
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
    timing = Timing(period=period, latency=operation.latency)
    loop = LiftedLoop(model, controller, timing)
    if not loop.is_stable:
        return None
    multipliers = np.linalg.eigvals(loop.matrix)
    abscissa = max(abscissa, math.log(float(np.max(np.abs(multipliers)))) / period)
    if _CONSTANTS / -abscissa / period > _MOST_SAMPLES:
        return None
    promise = Promise(problem, controller, operation, rtol=_RTOL)
    for threshold in 10.0 ** (rng.uniform(-1.5, -0.7) - np.arange(_FALLS)):
        held = held_at(problem, promise.held, float(threshold))
        if 0 < held.error < math.inf:
            break
    else:
        return None
    return PromiseCase(
        problem=replace(problem, tolerance=held.error),
        controller=controller,
        method=method,
        h_certified=float(threshold),
        uncertainty=drawn.uncertainty,
        abscissa=abscissa,
    )


def _run(case: PromiseCase, freedom: Freedom) -> FloatArray:
    """Deviations of a run."""
    problem, operation = case.problem, case.problem.operation
    assert operation is not None
    model, period = problem.model, operation.sampling_period
    deviation = freedom.start * largest_start(problem)
    y = problem.scene.luminosity(model, problem.equilibrium.state + deviation)
    c = case.uncertainty
    bounds = ReferenceBounds(lower=y * (1 - c), upper=y * (1 + c))
    step = case.h_certified * math.log(problem.log_base)
    first = np.clip(y * np.exp(0.999 * step * freedom.references), bounds.lower, bounds.upper)
    centre = round(operation.latency / period * TICKS)
    jitter = round(operation.latency_jitter / period * TICKS)
    return run_late(
        replace(problem, bounds=bounds),
        case.controller,
        LateRun(
            plant=in_error(model, freedom, operation.model_uncertainty),
            deviation=deviation,
            first_reference=first,
            event_threshold=case.h_certified,
            latencies=centre + jitter * freedom.lateness,
            disturbance=freedom.push * operation.disturbance_bound,
            greedy=freedom.greedy,
        ),
    ).deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """How a run ended.

    Parameters
    ----------
    limsup
        Largest deviation of its last fifth; NaN after a luminosity that is not positive.
    settled
        Whether it was within the tolerance then, or fell no more; False where `limsup` is NaN.
    """

    limsup: float
    settled: bool


def end_of(path: FloatArray, tolerance: float) -> End:
    """Read the end of a run.

    Parameters
    ----------
    path
        Deviations at all ticks, shape (K TICKS, n).
    tolerance
        eps.
    """
    fifth = len(path) // 5
    sizes = size_of(path[-2 * fifth :])
    before, last = float(sizes[:fifth].max()), float(sizes[fifth:].max())
    return End(limsup=last, settled=regulated(last, tolerance) or last >= _FALLING * before)


def _settled(case: PromiseCase, freedom: Freedom) -> End:
    """End of a run that goes on while it falls outside the tolerance."""
    for doublings in range(_CONTINUATIONS + 1):
        path = _run(case, freedom.repeated(2**doublings))
        end = end_of(path, case.problem.tolerance)
        if end.settled or math.isnan(end.limsup):
            break
    return end


def _positive_is_promised(case: PromiseCase, freedom: Freedom) -> bool:
    """Whether bounds from the start on exist: every luminosity is positive within them."""
    start = freedom.start * largest_start(case.problem)
    held = held_from(case.problem, case.controller, case.h_certified, start=start)
    return math.isfinite(held.error)


def _row(seed: int, case: PromiseCase, freedom: Freedom) -> Row:
    operation, model = case.problem.operation, case.problem.model
    assert operation is not None
    end = _settled(case, freedom)
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
        'limsup': end.limsup,
        'ratio': end.limsup / case.problem.tolerance,
        'settled': end.settled,
        'light_promised': math.isnan(end.limsup) and _positive_is_promised(case, freedom),
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
    settled = np.array([row['settled'] == 'True' for row in rows])
    promised = np.array([row['light_promised'] == 'True' for row in rows])
    return PromiseSummary(
        runs=int(lit.sum()),
        plants=len({row['seed'] for row, is_lit in zip(rows, lit, strict=True) if is_lit}),
        violations=int(np.sum(~kept(ratios[settled]))),
        tightest=float(ratios[settled].max(initial=0.0)),
        dark=int(np.sum(~lit)),
        dark_though_promised=int(np.sum(promised)),
        unsettled=int(np.sum(lit & ~settled)),
    )
