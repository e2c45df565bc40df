"""The threshold of the loop that runs: held commands, latency, disturbances, a plant in error."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_hinf_controller.analysis.largest_threshold import (
    held_at,
    largest_threshold,
    largest_uncertainty,
)
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, Timing
from dvs_hinf_controller.analysis.promise import Promise
from dvs_hinf_controller.analysis.sampled_gains import SampledGains
from dvs_hinf_controller.analysis.thresholds import event_threshold
from dvs_hinf_controller.design import Design, design_from_scenario
from dvs_hinf_controller.design.certification import farthest_start, held_from
from dvs_hinf_controller.design.design_report import as_json_object, report_text
from dvs_hinf_controller.design.design_warnings import RunningLoop, design_warnings
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem

CONFIG = Path(__file__).parents[3] / 'config'


@pytest.fixture(scope='module')
def mirror() -> Scenario:
    return Scenario.from_values({'pixel_offsets': [0.0, 0.0], 'pixel_grid': [1, 1]})


@pytest.fixture(scope='module')
def designs(mirror: Scenario) -> dict[str, Design]:
    return {
        method: design_from_scenario(mirror.replace(method=method))
        for method in ('structured', 'unstructured')
    }


@pytest.mark.parametrize(
    ('method', 'period', 'latency', 'threshold'),
    [
        ('structured', 1e-3, 0.0, 0.1201),
        ('structured', 5e-3, 0.0, 0.1140),
        ('structured', 1e-2, 0.0, 0.1007),
        ('structured', 1e-3, 1e-3, 0.1178),
        ('structured', 5e-3, 5e-3, 0.0843),
        ('structured', 1e-2, 1e-2, 0.0130),
        ('unstructured', 1e-3, 0.0, 0.1146),
        ('unstructured', 5e-3, 0.0, 0.1112),
        ('unstructured', 1e-2, 0.0, 0.1052),
        ('unstructured', 1e-3, 1e-3, 0.1131),
        ('unstructured', 5e-3, 5e-3, 0.0984),
        ('unstructured', 1e-2, 1e-2, 0.0680),
    ],
)
def test_thresholds_of_held_and_late_commands(designs, method, period, latency, threshold) -> None:
    """Measured independently on a plain grid of phases and times (issue 12, section 10)."""
    design = designs[method]
    loop = LiftedLoop(
        design.problem.model, design.controller, Timing(period=period, latency=latency)
    )
    gains = SampledGains(loop).of_measurement()
    problem = design.problem
    fed_back = problem.tolerance * float(gains.output[0])
    delta = problem.tolerance / (gains.error * problem.mean_luminosity + fed_back)

    assert event_threshold(problem, delta) == pytest.approx(threshold, abs=7e-4)


def threshold(design: Design, **operation) -> float:
    held = Promise(
        design.problem, design.controller, Operation(sampling_period=1e-3, **operation)
    ).held
    return largest_threshold(design.problem, held)


def test_every_part_of_the_promise_costs_threshold(designs) -> None:
    design = designs['unstructured']
    plain = threshold(design)

    assert plain < design.figures.h_certified_continuous
    for part in (
        {'latency': 2e-3},
        {'latency': 2e-3, 'latency_jitter': 5e-4},
        {'disturbance_bound': np.array([0.01])},
        {'model_uncertainty': 0.01},
    ):
        assert 0 < threshold(design, **part) < plain
    assert threshold(design, latency=2e-3, latency_jitter=5e-4) < threshold(design, latency=2e-3)


def test_the_report_adds_the_parts_up(mirror) -> None:
    figures = design_from_scenario(
        mirror.replace(loop_latency=1e-3, model_uncertainty=0.01, disturbance_bound=[0.01])
    ).figures
    thresholds = [cost.threshold for cost in figures.costs]

    assert [cost.part for cost in figures.costs] == [
        'continuous loop',
        'commands held for 1 ms',
        'latency 1 ms',
        'camera interpolates samples',
        'disturbance of the inputs',
        '1 % error of A and B',
    ]
    assert thresholds == sorted(thresholds, reverse=True)
    assert thresholds[0] == figures.h_certified_continuous
    assert thresholds[-1] == figures.h_certified


SENSOR = {'threshold_uncertainty': [0.02, 0.03], 'leak_uncertainty': 0.05}
ANCHORS = {'anchor_period': 0.033, 'anchor_uncertainty': 0.01}


def test_a_sensor_in_error_costs_threshold_by_parts(mirror) -> None:
    figures = design_from_scenario(
        mirror.replace(**SENSOR, **ANCHORS, latency_uncertainty=1e-3)
    ).figures
    thresholds = [cost.threshold for cost in figures.costs]

    assert [cost.part for cost in figures.costs[3:]] == [
        'events late by up to 1 ms',
        'anchors within 1 % every 33 ms',
        'threshold uncertainty 2 % ON, 3 % OFF',
        'leak up to 0.05/s',
    ]
    assert thresholds == sorted(thresholds, reverse=True)
    assert 0.02 < thresholds[-1] == figures.h_certified < thresholds[-3]


@pytest.mark.parametrize('name', ['threshold_uncertainty', 'leak_uncertainty'])
def test_a_drift_that_nothing_ends_is_not_covered_and_named(mirror, name) -> None:
    drifting = mirror.replace(event_threshold=0.1, **{name: SENSOR[name]})
    design = design_from_scenario(drifting)
    texts = (
        report_text([design], event_threshold=0.1),
        ' '.join(design_warnings(design, RunningLoop.of_scenario(drifting))),
        str(as_json_object(design)['costs']),
    )

    assert design.figures.h_certified == -math.inf
    assert as_json_object(design)['h_certified'] == 0
    assert design.figures.delta_certified > 0.1
    assert all('not covered' in text.lower() for text in texts)


@pytest.mark.parametrize(
    'harder',
    [
        {'anchor_period': 0.05},
        {'anchor_uncertainty': 0.03},
        {'threshold_uncertainty': [0.03]},
        {'leak_uncertainty': 1.0},
        {'latency_uncertainty': 1e-3},
    ],
)
def test_what_is_worse_of_a_sensor_costs_more(designs, mirror, harder) -> None:
    controller, found = designs['unstructured'].controller, []
    for values in ({}, harder):
        problem = DesignProblem.from_scenario(mirror.replace(**{**SENSOR, **ANCHORS, **values}))
        held = Promise(problem, controller, problem.operation).held
        found.append(largest_threshold(problem, held))

    assert 0 < found[1] < found[0]


def test_anchors_take_the_place_of_references_that_are_known_poorly(designs, mirror) -> None:
    controller = designs['unstructured'].controller

    def certified(**values: float) -> float:
        problem = DesignProblem.from_scenario(mirror.replace(**values))
        return largest_threshold(problem, Promise(problem, controller, problem.operation).held)

    poorly, anchored = (
        certified(reference_uncertainty=0.06),
        certified(reference_uncertainty=0.06, **ANCHORS),
    )

    assert anchored > poorly
    # One threshold for the event and one for the anchor at its worst instant.
    delta = designs['unstructured'].figures.delta_certified
    assert anchored == pytest.approx((math.atanh(delta) - math.atanh(0.01)) / 2, rel=1e-3)
    assert certified(reference_uncertainty=1e-3, **ANCHORS) == certified(
        reference_uncertainty=1e-3
    )


def test_each_pixel_counts_with_what_is_known_of_it(mirror) -> None:
    """One pixel of nine that is known poorly costs a ninth of what it would cost alone."""
    nine = mirror.replace(pixel_offsets=[0.0, 0.0] * 9, pixel_grid=[1, 9])
    design = design_from_scenario(nine)
    y = design.problem.set_point_luminosity
    wide = nine.replace(
        reference_lower=(y * np.array([0.8] + [0.99] * 8)).tolist(),
        reference_upper=(y * np.array([1.2] + [1.01] * 8)).tolist(),
    )
    problem = DesignProblem.from_scenario(wide)
    held = Promise(problem, design.controller, problem.operation).held
    mean = largest_threshold(problem, held)
    worst = event_threshold(problem, largest_uncertainty(problem, held))

    assert worst < 0 < mean
    assert held_at(problem, held, mean).error == pytest.approx(problem.tolerance, rel=1e-6)


def test_every_luminosity_stays_positive_or_there_is_no_promise(mirror) -> None:
    """At a set-point of little light the tolerance is wide enough for one that is not positive."""
    scenario = mirror.replace(tolerance=10.0)
    design = design_from_scenario(scenario)
    held = held_from(design.problem, design.controller, design.figures.h_certified)

    assert held.output < design.problem.set_point_luminosity.min()
    assert held.error < 10.0
    beyond = held_from(design.problem, design.controller, 1.02 * design.figures.h_certified)
    assert beyond.error == math.inf


def test_a_start_is_bounded_from_then_on(designs) -> None:
    design = designs['unstructured']
    start = np.array([0.01, -0.02])
    held = held_from(design.problem, design.controller, 0.05, start=start)
    limit = held_from(design.problem, design.controller, 0.05)

    assert held.error > max(float(np.linalg.norm(start)), limit.error)
    assert np.all(held.commands > limit.commands)


@pytest.mark.parametrize('direction', [[1.0, 0.0], [-0.3, 0.4], [0.0, 1e-3]])
def test_the_farthest_start_is_the_last_from_which_a_positive_luminosity_is_promised(
    designs, direction
) -> None:
    design = designs['unstructured']
    arguments = (design.problem, design.controller, 0.05)
    start = farthest_start(*arguments, np.array(direction))

    assert np.linalg.norm(start) > 0.01
    assert math.isfinite(held_from(*arguments, start=start).error)
    assert held_from(*arguments, start=1.001 * start).error == math.inf


def test_without_a_promise_there_is_no_farthest_start(designs) -> None:
    design = designs['unstructured']

    assert not farthest_start(design.problem, design.controller, 0.9, np.array([1.0, 0.0])).any()


def test_a_disturbance_that_no_controller_bears_leaves_no_promise(designs) -> None:
    assert threshold(designs['unstructured'], disturbance_bound=np.array([100.0])) == -math.inf


@pytest.mark.parametrize(
    ('values', 'name'),
    [
        ({'loop_latency': 1e-3, 'loop_latency_jitter': 2e-3}, 'latency_jitter'),
        ({'disturbance_bound': [0.1, 0.1]}, 'disturbance_bound'),
    ],
)
def test_an_operation_that_cannot_be_is_refused(mirror, values, name) -> None:
    with pytest.raises(ParameterError, match=name):
        DesignProblem.from_scenario(mirror.replace(**values))


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    period=st.floats(1e-3, 3e-2),
    share=st.sampled_from([0.0, 0.4, 1.0, 1.7]),
)
def test_no_signal_beats_the_gains(designs, seed, period, share) -> None:
    """The loop stepped with piecewise constant w of size one stays below N_T and N_G."""
    design = designs['unstructured']
    model, k = design.problem.model, design.controller
    timing = Timing(period=period, latency=share * period)
    loop = LiftedLoop(model, k, timing)
    if not loop.is_stable:
        return
    gains = SampledGains(loop).of_measurement()
    rng = np.random.default_rng(seed)
    n, order, parts = model.state_count, k.order, 10
    flow = np.zeros((n + order + 2,) * 2)
    flow[:n, :n], flow[:n, -2] = model.state_matrix, model.input_matrix[:, 0]
    flow[n:-2, :n] = np.outer(k.input_vector, model.output_vector)
    flow[n:-2, n:-2], flow[n:-2, -1] = k.state_matrix, k.input_vector
    step = scipy.linalg.expm(flow * period / parts)
    late = round(share * parts)
    commands = [0.0] * (late // parts + 2)
    state, w = np.zeros(n + order + 2), 1.0
    for tick in range(400 * parts):
        if tick % parts == 0:
            commands = [float(k.output_matrix[0] @ state[n:-2]), *commands[:-1]]
        age = late // parts + (tick % parts < late % parts)
        w = -w if rng.random() < 0.05 else w
        state[-2:] = commands[age], w
        state = step @ state
        assert np.linalg.norm(state[:n]) <= gains.error
        assert abs(model.output_vector @ state[:n]) <= gains.output


@cache
def certified(name: str, **changes) -> Design:
    return design_from_scenario(
        load_scenario(CONFIG / f'{name}.yaml').replace(method='certified', **changes)
    )


@pytest.mark.ensemble
@pytest.mark.parametrize(
    ('name', 'changes'),
    [
        ('mirror_r1', {'sampling_period': 5e-3, 'loop_latency': 5e-3}),
        ('paper_r1', {'sampling_period': 1e-3}),
    ],
)
def test_gains_are_as_accurate_as_asked(name, changes) -> None:
    """Filters far beyond the plant's rate: instants within a period are taken as they ask."""
    design = certified(name, **changes)
    problem, operation = design.problem, design.problem.operation
    timing = Timing(period=operation.sampling_period, latency=operation.latency)
    weights = problem.error_weights
    loop = LiftedLoop(problem.model, design.controller, timing, weights=weights)
    finest = SampledGains(loop, rtol=3e-5).of_measurement()
    for rtol in (1e-2, 1e-3):
        found = SampledGains(loop, rtol=rtol).of_measurement()
        assert finest.error * (1 - 3e-5) <= found.error <= finest.error * (1 + 2.5 * rtol)
        assert found.output == pytest.approx(finest.output, rel=2.5 * rtol)


@pytest.mark.ensemble
@pytest.mark.parametrize(
    ('name', 'changes', 'least'),
    [
        ('mirror_r1', {'integral_action': True}, 0.115),
        ('mirror_r1', {'model_uncertainty': 0.01}, 0.093),
        ('../examples/mujoco_cart_pole/cart_pole', {'model_uncertainty': 0.01}, 0.0038),
    ],
)
def test_some_family_suits_every_kind_of_loop(name, changes, least) -> None:
    """They are not reached without the families of a fast observer; see the textbook plants."""
    assert certified(name, **changes).figures.h_certified >= least


@pytest.mark.ensemble
@pytest.mark.parametrize(
    ('name', 'timing', 'least'),
    [
        ('paper_r1', {'sampling_period': 1e-3}, 0.130),
        ('mirror_r1', {'sampling_period': 5e-3, 'loop_latency': 5e-3}, 0.119),
    ],
)
def test_certified_designs_for_the_loop_that_runs(name, timing, least) -> None:
    """Must hold 1: 0.130 at 1 ms; above 0.10 at 5 ms with 5 ms of latency."""
    figures = certified(name, **timing).figures

    assert figures.h_certified >= least
    if 'loop_latency' not in timing:
        assert figures.h_certified >= 0.98 * figures.h_certified_continuous
