"""Study `pixels`: does the long-run error really grow with the number of pixels?

The paper observes that it "seems to increase" with r = 1, 3, 9, from one run each.
"""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.design.design import design_controller
from dvs_hinf_controller.problem import DesignProblem
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.paper.published import PIXEL_OFFSETS, scenario
from dvs_simulation.sweep.study import Row, Study, Task
from dvs_simulation.sweep.threshold import random_start

COLUMNS = ('pixels', 'layout', 'h', 'h_star', 'status', 'limsup', 'mean', 'events')
COUNTS = (1, 3, 9, 25, 81, 289, 1089)
_DURATION_S, _TAIL_S = 12.0, 8.0


def pixels_study(*, runs: int = 200, threshold: float = 0.14, seed: int = 0) -> Study:
    """Study over the number of pixels.

    Parameters
    ----------
    runs
        Runs for each, from random x(0) and q(0).
    threshold
        h of all runs.
    seed
        Seed of the runs.
    """
    tasks = [
        Task(
            key=f'r{count}',
            parameters={'count': count, 'threshold': threshold, 'runs': runs, 'seed': seed},
            rows=runs,
        )
        for count in COUNTS
    ]
    options = {'runs': runs, 'threshold': threshold, 'seed': seed}
    return Study(
        name='pixels', columns=COLUMNS, function=run_pixels_task, tasks=tasks, options=options
    )


def pixel_layout(count: int) -> FloatArray:
    """The paper's offsets up to nine pixels, beyond them a finer square grid of the same extent.

    Parameters
    ----------
    count
        r: at most nine, or an odd square.
    """
    if count <= len(PIXEL_OFFSETS):
        return PIXEL_OFFSETS[:count]
    line = np.linspace(-0.01, 0.01, round(count**0.5))
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def run_pixels_task(*, count: int, threshold: float, runs: int, seed: int) -> list[Row]:
    """Rows of one number of pixels.

    Parameters
    ----------
    count
        r.
    threshold
        h.
    runs
        Number of runs.
    seed
        Seed of the runs.
    """
    plain = scenario('mirror', count, event_threshold=threshold, offsets=pixel_layout(count))
    design = design_controller(DesignProblem.from_scenario(plain).continuous, method='structured')
    loop = ClosedLoop.from_scenario(plain, design.controller)
    rows: list[Row] = []
    for i in range(runs):
        run = simulate(
            random_start(loop, np.random.default_rng([seed, i])),
            duration=_DURATION_S,
            tail_start=_DURATION_S - _TAIL_S,
            tail_step=0.01,
            record_events=False,
        )
        rows.append(
            {
                'pixels': count,
                'layout': 'paper' if count <= len(PIXEL_OFFSETS) else 'grid',
                'h': threshold,
                'h_star': design.figures.h_star,
                'status': run.outcome.status,
                'limsup': run.limsup,
                'mean': run.mean_error,
                'events': run.event_count,
            }
        )
    return rows
