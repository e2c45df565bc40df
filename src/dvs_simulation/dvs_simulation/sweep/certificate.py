"""Study `certificate`: no run below h_certified may leave the tolerance, on any plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.exact.trajectory import Trajectory
from dvs_simulation.judging.measures import kept
from dvs_simulation.sweep.random_loops import METHODS, RandomCase, random_case
from dvs_simulation.sweep.study import Row, Study, Task

COLUMNS = (
    'seed',
    'method',
    'states',
    'inputs',
    'pixels',
    'log_base',
    'tolerance',
    'h',
    'h_certified',
    'h_star',
    'status',
    'limsup',
    'limsup_bound',
    'ratio',
    'events',
)
# Closed-loop time constants of the transient that is left out and of the tail that is watched.
_TRANSIENT, _TAIL = 15.0, 15.0
_MOST_EVENTS = 3000


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateSummary:
    """Outcome of the study.

    Parameters
    ----------
    runs
        Completed runs.
    plants
        Different plants among them.
    violations
        Runs whose error, bounded between steps too, exceeded the tolerance.
    tightest
        Largest ``limsup / eps``.
    dark
        Runs that were left out because a luminosity tended to 0 in the transient: there the pixel
        is not defined (paper, A1).
    """

    runs: int
    plants: int
    violations: int
    tightest: float
    dark: int


def certificate_study(*, plants: int = 220, runs: int = 500, seed: int = 0) -> Study:
    """Study over `plants` random plants with `runs` runs each.

    Parameters
    ----------
    plants
        Number of plants with a controller.
    runs
        Runs of each: random x(0), q(0) and h up to h_certified.
    seed
        Seed of everything.
    """
    tasks = [
        Task(
            key=f'plant-{i}',
            parameters={'seed': seed * 1_000_003 + i, 'method': _method(i), 'runs': runs},
            rows=runs,
        )
        for i in range(plants)
    ]
    return Study(
        name='certificate',
        columns=COLUMNS,
        function=run_certificate_task,
        tasks=tasks,
        options={'plants': plants, 'runs': runs, 'seed': seed},
    )


def _method(index: int) -> str:
    """Every twentieth controller is an L1 design, which takes longest."""
    return 'certified' if index % 20 == 19 else METHODS[index % len(METHODS)]


def run_certificate_task(*, seed: int, method: str, runs: int) -> list[Row]:
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
    case = random_case(seed, method, accept=_affordable)
    rng = np.random.default_rng([seed, 1])
    rows = []
    for _ in range(runs):
        loop = random_run(case, rng)
        rows.append(_row(seed, case, loop, _watched(case, loop)))
    return rows


def _affordable(case: RandomCase) -> bool:
    """Whether a run takes a moment only: a slow pole beside a fast limit cycle takes minutes."""
    loop = random_run(case, np.random.default_rng(0))
    return _watched(case, loop).event_count <= _MOST_EVENTS


def random_run(case: RandomCase, rng: np.random.Generator) -> ClosedLoop:
    """Loop with random initial state, references and a threshold up to the certified one.

    Parameters
    ----------
    case
        Plant and controller.
    rng
        Source of randomness.
    """
    problem, model = case.problem, case.problem.model
    direction = rng.standard_normal(model.state_count)
    room = 0.4 * float(np.min(problem.set_point_luminosity))
    reach = room / float(np.linalg.norm(model.gradient)) * rng.random()
    start = problem.equilibrium.state + reach * direction / np.linalg.norm(direction)
    y = problem.scene.luminosity(model, start)
    bounds = ReferenceBounds(lower=y * (1 - case.uncertainty), upper=y * (1 + case.uncertainty))
    share = 1.0 if rng.random() < 0.3 else float(rng.uniform(0.25, 1.0))
    threshold = share * case.figures.h_certified
    spread = np.exp(rng.uniform(-1, 1, y.size) * 0.999 * threshold * np.log(problem.log_base))
    return ClosedLoop(
        model=model,
        equilibrium=problem.equilibrium,
        scene=problem.scene,
        controller=case.controller,
        bounds=bounds,
        initial_state=start,
        event_threshold=threshold,
        log_base=problem.log_base,
        initial_reference=np.clip(y * spread, bounds.lower, bounds.upper),
    )


def _watched(case: RandomCase, loop: ClosedLoop) -> Trajectory:
    constant = 1 / -case.figures.closed_loop_abscissa
    return simulate(
        loop,
        duration=(_TRANSIENT + _TAIL) * constant,
        tail_start=_TRANSIENT * constant,
        tail_step=_TAIL * constant / 500,
        record_events=False,
        max_events=2_000_000,
    )


def _row(seed: int, case: RandomCase, loop: ClosedLoop, run: Trajectory) -> Row:
    return {
        'seed': seed,
        'method': case.method,
        'states': loop.model.state_count,
        'inputs': loop.model.input_count,
        'pixels': loop.pixel_count,
        'log_base': loop.log_base,
        'tolerance': case.problem.tolerance,
        'h': loop.event_threshold,
        'h_certified': case.figures.h_certified,
        'h_star': case.figures.h_star,
        'status': run.outcome.status,
        'limsup': run.limsup,
        'limsup_bound': run.limsup_bound,
        'ratio': run.limsup_bound / case.problem.tolerance,
        'events': run.event_count,
    }


def summarize_certificate(rows: list[dict[str, str]]) -> CertificateSummary:
    """Figures of the study.

    Parameters
    ----------
    rows
        Rows of its table.
    """
    completed = [row for row in rows if row['status'] == 'completed']
    ratios = np.array([float(row['ratio']) for row in completed])
    return CertificateSummary(
        runs=len(completed),
        plants=len({row['seed'] for row in completed}),
        violations=int(np.sum(~kept(ratios))),
        tightest=float(ratios.max(initial=0.0)),
        dark=len(rows) - len(completed),
    )
