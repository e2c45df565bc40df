"""No run of the sampled loop within what was promised leaves the tolerance."""

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.sampled.late_loop import TICKS, LateRun, run_late
from dvs_simulation.sampled.sampled_loop import run_sampled
from dvs_simulation.sweep.promise import (
    METHODS,
    end_of,
    promise_study,
    run_promise_task,
    summarize_promise,
)


def as_text(rows):
    return [{name: str(value) for name, value in row.items()} for row in rows]


@pytest.mark.parametrize('period', [0.001, 0.01])
def test_the_compiled_loop_is_the_loop_of_the_nodes(period) -> None:
    """Same states at the samples as the nodes' own cores give, message by message."""
    scenario = Scenario.from_values({'duration': 0.5, 'sampling_period': period})
    run = run_sampled(scenario)
    states = decode_trace(run.messages).states
    problem, samples = run.design.problem, round(0.5 / period)
    model = problem.model
    start = scenario.initial_state
    path = run_late(
        problem,
        run.design.controller,
        LateRun(
            plant=model,
            deviation=start - problem.equilibrium.state,
            first_reference=problem.scene.luminosity(model, start),
            event_threshold=scenario.sensor.event_threshold,
            latencies=np.zeros(samples, np.int64),
            disturbance=np.zeros((samples * TICKS, 1)),
            greedy=np.zeros((1, 2)),
        ),
    )

    # Event stamps of the nodes are whole nanoseconds.
    np.testing.assert_allclose(
        path[::TICKS] + problem.equilibrium.state, states[:samples], atol=2e-6
    )


def test_no_adversarial_run_breaks_a_promise() -> None:
    """Seeds whose designs take little time."""
    cases = [('lqg', 0), ('lqg', 2), ('lqg', 4), ('certified', 2003)]
    rows = [
        row for method, seed in cases for row in run_promise_task(seed=seed, method=method, runs=8)
    ]
    summary = summarize_promise(as_text(rows))

    assert summary.violations == summary.dark_in_spite == summary.unsettled == 0
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
    assert (summary.dark_in_spite, summary.unsettled) == (1, 1)
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
