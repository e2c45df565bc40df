"""Study `threshold` of a user's own scenario: random and adversarial runs, every method."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError, SuiteError
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.synthesis.methods import METHODS
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.judging.measures import regulated, settled_from
from dvs_simulation.sweep.study import Row, Study, Task

COLUMNS = (
    'method',
    'kind',
    'h',
    'h_star',
    'h_certified',
    'tolerance',
    'status',
    'limsup',
)
NAME = 'own_plant'
_SHORTEST_S = 1e-3
_MOST_TRIALS = 200
# A step of the adversary, as a share of its room, and how it shrinks where nothing gets worse.
_FIRST_STEP, _SHRINK = 0.5, 0.8
# Share of the tolerance that the slowest pole leaves of the farthest start.
_LEFT_OF_THE_START = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnThreshold:
    """Thresholds of one method.

    Parameters
    ----------
    method
        How the controller was found.
    random
        Least h at which a random run left the tolerance; infinite if none did.
    adversarial
        The same for a run that was made worse step by step.
    h_star
        Published bound.
    h_certified
        Guaranteed bound for the loop that runs.
    """

    method: str
    random: float
    adversarial: float
    h_star: float
    h_certified: float


def own_plant_study(
    scenario: Scenario, *, steps: int = 25, runs: int = 40, seed: int = 0
) -> Study:
    """Study over all methods that find a controller and `steps` thresholds.

    Parameters
    ----------
    scenario
        The user's.
    steps
        Number of thresholds, up to three times what is published or guaranteed.
    runs
        Random runs at each, and as many steps of the adversary.
    seed
        Seed of the runs.

    Raises
    ------
    ParameterError
        If the run has no end, there are several pixel groups, or no method finds a controller
        with a finite threshold.
    """
    if scenario.loop.duration < _SHORTEST_S:
        raise ParameterError('duration', scenario.loop.duration, 'must be > 0 for this study')
    scenario.model.require_one_group('this study')
    tasks = []
    for method in METHODS:
        try:
            figures = design_from_scenario(scenario.replace(method=method)).figures
        except SuiteError as error:
            print(f'{method}: left out: {error}')
            continue
        bounds = [h for h in (figures.h_star, figures.h_certified) if 0 < h < math.inf]
        if not bounds:
            print(f'{method}: left out: h* and h_certified are none, or any')
            continue
        thresholds = (3 * max(bounds) * np.arange(1, steps + 1) / steps).tolist()
        parameters = {
            'scenario': scenario,
            'method': method,
            'thresholds': thresholds,
            'runs': runs,
            'seed': seed,
        }
        tasks.append(Task(key=method, parameters=parameters, rows=2 * steps))
    if not tasks:
        raise ParameterError('params_file', 'scenario', 'has no method with a threshold to study')
    digest = hashlib.sha256(repr(sorted(scenario.values.items())).encode()).hexdigest()[:16]
    return Study(
        name=NAME,
        columns=COLUMNS,
        function=run_own_plant_task,
        tasks=tasks,
        options={'steps': steps, 'runs': runs, 'seed': seed, 'scenario': digest},
    )


def run_own_plant_task(
    *, scenario: Scenario, method: str, thresholds: list[float], runs: int, seed: int
) -> list[Row]:
    """Two rows a threshold: the worst of the random runs, and what the adversary made of it.

    Parameters
    ----------
    scenario
        Sensor, plant and controller.
    method
        How the controller is found.
    thresholds
        All h.
    runs
        Random runs at each h, and steps of the adversary.
    seed
        Seed of the runs.
    """
    scenario = scenario.replace(method=method)
    design = design_from_scenario(scenario)
    loop = ClosedLoop.from_scenario(scenario, design.controller)
    rows = []
    for h in thresholds:
        search = _Adversary(
            loop.with_threshold(h),
            scenario,
            np.random.default_rng([seed, 1]),
            slowest_pole=design.figures.closed_loop_abscissa,
        )
        for kind, limsup in (('random', search.random(runs)), ('adversarial', search.climb(runs))):
            rows.append(
                {
                    'method': method,
                    'kind': kind,
                    'h': h,
                    'h_star': design.figures.h_star,
                    'h_certified': design.figures.h_certified,
                    'tolerance': design.problem.tolerance,
                    'status': 'completed' if math.isfinite(limsup) else 'broken off',
                    'limsup': limsup,
                }
            )
    return rows


class _Adversary:
    """Searches starts and references for the largest limsup at one threshold."""

    def __init__(
        self,
        loop: ClosedLoop,
        scenario: Scenario,
        rng: np.random.Generator,
        *,
        slowest_pole: float,
    ) -> None:
        self._loop, self._rng = loop, rng
        # The bounds on h are for m and M in this proportion: a dimmer start must not know less.
        first = np.abs(loop.initial_luminosity())
        self._lower, self._upper = loop.bounds.lower / first, loop.bounds.upper / first
        self._room = self._free_room(scenario)
        # A run that has not settled has not left eps.
        farthest = float(np.linalg.norm(scenario.error_weights * self._room))
        share = farthest / (_LEFT_OF_THE_START * scenario.objective.tolerance)
        settled_s = math.log(max(share, 1.0)) / -slowest_pole
        duration = 2 * float(scenario.loop.duration)
        self._duration = duration * max(1.0, settled_s / settled_from(duration))
        self._worst, self._at = 0.0, np.zeros(loop.model.state_count + loop.pixel_count)

    def _free_room(self, scenario: Scenario) -> FloatArray:
        weights = scenario.error_weights
        eps = scenario.objective.tolerance / np.where(weights > 0, weights, weights.max())
        away = np.abs(scenario.initial_state - self._loop.equilibrium.state)
        return np.asarray(np.maximum(away, eps))

    def random(self, runs: int) -> float:
        """Worst of some runs from anywhere in the room."""
        for _ in range(runs):
            for _ in range(_MOST_TRIALS):
                if self._try(self._rng.uniform(-1, 1, self._at.size)):
                    break
        return self._worst

    def climb(self, steps: int) -> float:
        """Worst after steps away from the worst so far, each kept if it makes it worse."""
        step = _FIRST_STEP
        for _ in range(steps):
            before = self._worst
            offset = step * self._rng.standard_normal(self._at.size)
            self._try(np.clip(self._at + offset, -1, 1))
            if self._worst <= before:
                step *= _SHRINK
        return self._worst

    def _try(self, place: FloatArray) -> bool:
        """Run from a place in the unit cube of starts and references; False if it is none."""
        loop, n = self._loop, self._loop.model.state_count
        start = loop.equilibrium.state + place[:n] * self._room
        y = loop.scene.luminosity(loop.model, start)
        if np.min(y) <= 0:
            return False
        bounds = type(loop.bounds)(lower=y * self._lower, upper=y * self._upper)
        middle, half = (bounds.lower + bounds.upper) / 2, (bounds.upper - bounds.lower) / 2
        try:
            moved = replace(
                loop,
                initial_state=start,
                bounds=bounds,
                initial_reference=middle + place[n:] * half,
            )
        except ParameterError:
            return False  # a fine threshold at which the pixel would fire at once
        run = simulate(
            moved,
            duration=self._duration,
            tail_start=settled_from(self._duration),
            tail_step=self._duration / 1000,
            record_events=False,
            max_events=200_000,
        )
        if run.limsup > self._worst:
            self._worst, self._at = run.limsup, place
        return True


def own_thresholds(rows: list[dict[str, str]]) -> list[OwnThreshold]:
    """Simulated critical h of every method.

    Parameters
    ----------
    rows
        Rows of the study's table.
    """
    result = []
    for method in dict.fromkeys(row['method'] for row in rows):
        mine = [row for row in rows if row['method'] == method]
        result.append(
            OwnThreshold(
                method=method,
                random=_first_broken([row for row in mine if row['kind'] == 'random']),
                adversarial=_first_broken(mine),
                h_star=float(mine[0]['h_star']),
                h_certified=float(mine[0]['h_certified']),
            )
        )
    return result


def _first_broken(rows: list[dict[str, str]]) -> float:
    broken = [
        float(row['h'])
        for row in rows
        if not regulated(float(row['limsup']), float(row['tolerance']))
    ]
    return min(broken, default=math.inf)
