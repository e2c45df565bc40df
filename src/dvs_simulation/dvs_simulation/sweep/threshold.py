"""Study `threshold`: from which h on does the simulated loop really leave its tolerance?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dvs_common.errors import ParameterError
from dvs_hinf_controller.design.design import Design, design_controller
from dvs_hinf_controller.problem import DesignProblem
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.judging.measures import regulated
from dvs_simulation.paper.published import scenario
from dvs_simulation.sweep.study import Row, Study, Task

METHODS = ('unstructured', 'structured', 'certified')
PIXELS = (1, 3, 9)
COLUMNS = (
    'method',
    'pixels',
    'h',
    'h_star',
    'h_certified',
    'tolerance',
    'status',
    'limsup',
    'mean',
)
_DURATION_S, _TAIL_S = 20.0, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CriticalThreshold:
    """Thresholds of one design.

    Parameters
    ----------
    method
        How the controller was found.
    pixels
        r.
    simulated
        Least h at which a run left the tolerance; infinite if none did.
    h_star
        Published bound.
    h_certified
        Guaranteed bound.
    """

    method: str
    pixels: int
    simulated: float
    h_star: float
    h_certified: float


def threshold_study(
    *, steps: int = 50, runs: int = 40, largest: float = 0.5, seed: int = 0
) -> Study:
    """Study over methods, pixels and `steps` thresholds up to `largest`.

    Parameters
    ----------
    steps
        Number of thresholds.
    runs
        Runs at each, from random x(0) and q(0).
    largest
        Largest h.
    seed
        Seed of the runs.
    """
    thresholds = (largest * np.arange(1, steps + 1) / steps).tolist()
    tasks = [
        Task(
            key=f'{method}-r{pixels}',
            parameters={
                'method': method,
                'pixels': pixels,
                'thresholds': thresholds,
                'runs': runs,
                'seed': seed,
            },
            rows=steps * runs,
        )
        for method in METHODS
        for pixels in PIXELS
    ]
    options = {'steps': steps, 'runs': runs, 'largest': largest, 'seed': seed}
    return Study(
        name='threshold',
        columns=COLUMNS,
        function=run_threshold_task,
        tasks=tasks,
        options=options,
    )


def run_threshold_task(
    *, method: str, pixels: int, thresholds: list[float], runs: int, seed: int
) -> list[Row]:
    """Rows of one design.

    Parameters
    ----------
    method
        How the controller is found.
    pixels
        r.
    thresholds
        All h.
    runs
        Runs at each h.
    seed
        Seed of the runs.
    """
    plain = scenario('mirror', pixels)
    design = design_controller(DesignProblem.from_scenario(plain).continuous, method=method)
    loop = ClosedLoop.from_scenario(plain, design.controller)
    return [
        _row(
            design,
            random_start(replace(loop, event_threshold=h), np.random.default_rng([seed, i])),
        )
        for h in thresholds
        for i in range(runs)
    ]


def random_start(loop: ClosedLoop, rng: np.random.Generator) -> ClosedLoop:
    """Same loop from a random state around its set-point and random references.

    Parameters
    ----------
    loop
        Loop with bounds of some width around its first luminosity.
    rng
        Source of randomness.
    """
    width = float(loop.bounds.upper[0] - loop.bounds.lower[0]) / 2
    while True:
        start = loop.equilibrium.state + rng.uniform(-0.1, 0.1, loop.model.state_count)
        y = loop.scene.luminosity(loop.model, start)
        if y.min() <= 2 * width:
            continue
        bounds = type(loop.bounds).around(y, width)
        reference = rng.uniform(bounds.lower, bounds.upper)
        try:
            return replace(loop, initial_state=start, bounds=bounds, initial_reference=reference)
        except ParameterError:
            continue  # a fine threshold near which the pixel would fire at once


def _row(design: Design, loop: ClosedLoop) -> Row:
    run = simulate(
        loop,
        duration=_DURATION_S,
        tail_start=_DURATION_S - _TAIL_S,
        tail_step=0.02,
        record_events=False,
        max_events=200_000,
    )
    return {
        'method': design.method,
        'pixels': loop.pixel_count,
        'h': loop.event_threshold,
        'h_star': design.figures.h_star,
        'h_certified': design.figures.h_certified,
        'tolerance': design.problem.tolerance,
        'status': run.outcome.status,
        'limsup': run.limsup,
        'mean': run.mean_error,
    }


def critical_thresholds(rows: list[dict[str, str]]) -> list[CriticalThreshold]:
    """Simulated critical h of every design.

    Parameters
    ----------
    rows
        Rows of the study's table.
    """
    result = []
    for method in METHODS:
        for pixels in PIXELS:
            mine = [r for r in rows if r['method'] == method and int(r['pixels']) == pixels]
            if not mine:
                continue
            broken = [
                float(r['h'])
                for r in mine
                if not regulated(float(r['limsup']), float(r['tolerance']))
            ]
            result.append(
                CriticalThreshold(
                    method=method,
                    pixels=pixels,
                    simulated=min(broken, default=float('inf')),
                    h_star=float(mine[0]['h_star']),
                    h_certified=float(mine[0]['h_certified']),
                )
            )
    return result
