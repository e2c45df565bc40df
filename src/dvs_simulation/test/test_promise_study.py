"""No run of the sampled loop within what was promised leaves the tolerance."""

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.sampled.late_loop import TICKS, LateRun, run_late
from dvs_simulation.sampled.sampled_loop import run_sampled
from dvs_simulation.sweep.promise import METHODS, promise_study, summarize_promise


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
    study = promise_study(plants=6, runs=3, seed=3)
    rows = [row for task in study.tasks for row in study.function(**task.parameters)]
    summary = summarize_promise(as_text(rows))

    assert {row['method'] for row in rows} == set(METHODS)
    assert summary.violations == 0
    assert summary.runs + summary.dark == 18
    assert 0.3 < summary.tightest <= 1


def test_a_violation_is_counted() -> None:
    rows = [
        {'seed': '1', 'ratio': '0.5'},
        {'seed': '1', 'ratio': '1.1'},
        {'seed': '2', 'ratio': 'nan'},
    ]
    summary = summarize_promise(rows)

    assert (summary.runs, summary.plants, summary.violations, summary.dark) == (2, 1, 1, 1)
    assert summary.tightest == 1.1


@pytest.mark.long
def test_no_adversarial_run_of_many_plants_breaks_a_promise() -> None:
    study = promise_study(plants=40, runs=100, seed=11)
    rows = [row for task in study.tasks for row in study.function(**task.parameters)]

    assert summarize_promise(as_text(rows)).violations == 0
