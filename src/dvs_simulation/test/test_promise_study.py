"""No run of the sampled loop within what was promised leaves the tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, Timing
from dvs_hinf_controller.design.design import Design, measure
from dvs_hinf_controller.problem import DesignProblem
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.conditions import Conditions
from dvs_simulation.sampled.late_loop import TICKS, LateRun, run_late
from dvs_simulation.sweep.promise import (
    METHODS,
    end_of,
    promise_study,
    run_promise_task,
    summarize_promise,
)
from dvs_simulation.sweep.random_loops import lqg_controller, random_problem

pytestmark = pytest.mark.ensemble


def as_text(rows):
    return [{name: str(value) for name, value in row.items()} for row in rows]


PERIODS = 300


def drawn_scenario(rng) -> Scenario:
    """A random plant before one to nine pixels; a whole number of ticks makes a period."""
    problem = random_problem(rng).problem
    model, c = problem.model, problem.model.output_vector
    offsets = np.outer(problem.scene.brightness_offsets, c / (c @ c))
    start = problem.equilibrium.state + 0.1 * rng.standard_normal(model.state_count)
    period = float(rng.choice([0.001, 0.005, 0.02]))
    threshold = float(rng.uniform(0.01, 0.1))
    least = np.abs(problem.scene.luminosity(model, start)).min()
    unknown = rng.choice([0.05, 0.5]) * threshold * np.log(problem.log_base) * least
    return Scenario.from_values(
        {
            'state_matrix': tuple(model.state_matrix.ravel()),
            'input_matrix': tuple(model.input_matrix.ravel()),
            'output_vector': tuple(c),
            'pixel_grid': (1, len(offsets)),
            'pixel_offsets': tuple(offsets.ravel()),
            'set_point': tuple(problem.equilibrium.state),
            'initial_state': tuple(start),
            'log_base': problem.log_base,
            'event_threshold': threshold,
            'reference_uncertainty': float(unknown),
            'sampling_period': period,
            'duration': PERIODS * period,
        }
    )


def both_loops(seed: int):
    """Samples and counts by the loop of the study and by the nodes' own cores, compiled.

    None where the loop is unstable, since rounding grows with the state, or starts near 0.
    """
    rng = np.random.default_rng([5, seed])
    scenario = drawn_scenario(rng)
    problem = DesignProblem.from_scenario(scenario)
    model = problem.model
    controller = lqg_controller(model, *(10.0 ** rng.uniform(-2, 0, 2)))
    figures = measure(problem, controller)
    y = problem.scene.luminosity(model, scenario.initial_state)
    period = scenario.loop.sampling_period
    for latency in (0.0, 1.6 * period):
        loop = LiftedLoop(model, controller, Timing(period=period, latency=latency))
        if not loop.is_stable or y.min() < 0.01:
            return None
    design = Design(method='file', problem=problem, controller=controller, figures=figures)
    late = rng.choice([0, 3, TICKS, 30]) + rng.integers(0, 3, PERIODS)
    push = 0.05 * rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(-1, 1, (PERIODS, model.input_count))
    error = 1 + 0.01 * rng.choice([-1, 0, 1], model.state_matrix.shape)
    plant = replace(model, state_matrix=model.state_matrix * error)
    bounds = problem.bounds
    first = y + rng.uniform(-0.9, 0.9, y.size) * (bounds.upper - bounds.lower) / 2
    path = run_late(
        problem,
        controller,
        LateRun(
            plant=plant,
            deviation=scenario.initial_state - problem.equilibrium.state,
            first_reference=first,
            event_threshold=scenario.sensor.event_threshold,
            latencies=late,
            disturbance=np.repeat(push, TICKS, axis=0),
            greedy=np.zeros((model.input_count, model.state_count)),
        ),
    )
    run = compiled_loop(scenario, design).run(
        Conditions(
            plant=plant,
            initial_state=scenario.initial_state,
            first_reference=first,
            disturbance=push,
            latencies_ns=np.append(late, 0) * (scenario.sampling_period_ns // TICKS),
        )
    )
    assert run is not None
    counts = np.zeros((PERIODS, y.size), int)
    at = np.searchsorted(np.arange(PERIODS) * scenario.sampling_period_ns, run.times_ns)
    inside = at < PERIODS
    np.add.at(counts, (at[inside], run.pixels[inside]), run.polarities[inside])
    whole = min(run.samples, PERIODS) - 1
    states = path.deviations[::TICKS] + problem.equilibrium.state
    return (
        (states[:whole], path.counts[:whole]),
        (run.record.states[:whole], counts.cumsum(axis=0)[:whole]),
    )


@pytest.mark.parametrize(
    'seeds', [range(10), pytest.param(range(10, 400), marks=pytest.mark.long)]
)
def test_the_loop_of_the_study_is_the_loop_of_the_nodes(seeds) -> None:
    """Every count at every sample, with latency, jitter, pushes and a plant in error.

    What the cores compile to has the bytes of the nodes (test_compiled_loop). Their stamps are
    whole nanoseconds, so that states differ a little.
    """
    cases = [case for case in map(both_loops, seeds) if case is not None]
    assert len(cases) >= 0.8 * len(seeds)
    for (states, counts), (wanted, wanted_counts) in cases:
        np.testing.assert_array_equal(counts, wanted_counts)
        np.testing.assert_allclose(states, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())
    assert sum(int(np.abs(counts).max()) for (_, counts), _ in cases) > len(cases)


def test_no_adversarial_run_breaks_a_promise() -> None:
    """Seeds whose designs take little time."""
    cases = [('lqg', 0), ('lqg', 2), ('lqg', 4), ('certified', 2003)]
    rows = [
        row for method, seed in cases for row in run_promise_task(seed=seed, method=method, runs=8)
    ]
    summary = summarize_promise(as_text(rows))

    assert summary.violations == summary.dark_though_promised == summary.unsettled == 0
    assert summary.runs + summary.dark == 32
    assert 0.3 < summary.tightest <= 1


def test_the_study_tries_every_method() -> None:
    study = promise_study(plants=12, runs=3)

    assert {task.parameters['method'] for task in study.tasks} == set(METHODS)


def test_a_violation_is_counted_and_a_run_that_still_falls_is_not() -> None:
    lit = {'settled': 'True', 'light_promised': 'False'}
    rows = [
        {'seed': '1', 'ratio': '0.5', **lit},
        {'seed': '1', 'ratio': '1.1', **lit},
        {'seed': '1', 'ratio': '1.7', 'settled': 'False', 'light_promised': 'False'},
        {'seed': '2', 'ratio': 'nan', 'settled': 'False', 'light_promised': 'False'},
        {'seed': '2', 'ratio': 'nan', 'settled': 'False', 'light_promised': 'True'},
    ]
    summary = summarize_promise(rows)

    assert (summary.runs, summary.plants, summary.violations, summary.dark) == (3, 1, 1, 2)
    assert (summary.dark_though_promised, summary.unsettled) == (1, 1)
    assert summary.tightest == 1.1


@pytest.mark.parametrize(
    ('rate', 'offset', 'settled'),
    [
        (0.5, 0.0, False),
        (0.5, 2.0, False),
        (20.0, 2.0, True),
        (20.0, 0.5, True),
        (-1.0, 2.0, True),
    ],
)
def test_a_run_outside_the_tolerance_that_still_falls_has_not_settled(
    rate, offset, settled
) -> None:
    path = offset + 3 * np.exp(-rate * np.linspace(0, 1, 100))[:, None]

    assert end_of(path, 1.0).settled is settled


def test_a_run_with_a_dark_pixel_has_no_end() -> None:
    end = end_of(np.full((100, 2), np.nan), 1.0)

    assert np.isnan(end.limsup)
    assert not end.settled


@pytest.mark.long
def test_no_adversarial_run_of_many_plants_breaks_a_promise() -> None:
    study = promise_study(plants=40, runs=100, seed=11)
    rows = [row for task in study.tasks for row in study.function(**task.parameters)]

    assert summarize_promise(as_text(rows)).violations == 0
