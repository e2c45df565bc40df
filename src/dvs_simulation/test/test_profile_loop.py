"""Loops before a brightness profile: inside the promise, judged by it, refused where exact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.design import Design, design_from_scenario
from dvs_hinf_controller.design.certification import held_from
from dvs_simulation.exact import ClosedLoop
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.trace import Trace, decode_trace
from dvs_simulation.judging.verdict import Verdict, judge
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.conditions import Conditions
from dvs_simulation.sampled.sampled_loop import run_by_messages, run_sampled

CONFIG = Path(__file__).resolve().parents[3] / 'config'


@pytest.fixture(scope='module')
def wall() -> Scenario:
    return load_scenario(CONFIG / 'printed_wall.yaml')


@pytest.fixture(scope='module')
def design(wall: Scenario) -> Design:
    return design_from_scenario(wall)


def traced(scenario: Scenario, design: Design, **conditions: object) -> Trace:
    run = run_by_messages(scenario, design=design, conditions=Conditions(**conditions))
    return decode_trace(run.messages)


def judged(trace: Trace, scenario: Scenario, design: Design) -> Verdict:
    return judge(
        trace,
        scenario,
        name='wall',
        promised=Promised.of(design),
        wall_seconds=1.0,
        interrupted=False,
    )


def test_the_printed_wall_is_regulated_within_its_promise(wall, design):
    trace = traced(wall, design)
    verdict = judged(trace, wall, design)

    assert verdict.passed and verdict.certified and not verdict.cycles_beyond_profile
    assert 0.5 < verdict.sector_ratio_max <= 1
    assert verdict.limsup_error <= held_from(design.problem, design.controller, verdict.h).error
    seen = wall.scene.profile.luminosity(
        (trace.states @ wall.model.output_vector)[:, None] + wall.scene.brightness_offsets
    )
    np.testing.assert_allclose(trace.luminosities, seen, rtol=1e-12)


def test_what_the_controller_takes_for_its_error_is_inside_the_widened_sector(wall, design):
    """``|mean z - mean D - v| <= delta (D + (1 + e)|v|) + e |v|`` of ``v = k c'(x - x_d)``."""
    problem, line = design.problem, design.problem.operation.linearisation
    bound = sector(problem.bounds, event_threshold=0.04, log_base=problem.log_base).error_bound
    target = problem.set_point_luminosity
    short = wall.replace(duration=0.5)
    random = np.random.default_rng(4)
    for _ in range(3):
        start = wall.equilibrium.state + random.uniform(-0.04, 0.04, 2)
        first = short.replace(initial_state=start.tolist())
        trace = traced(first, design_from_scenario(first))
        moved = (trace.states - problem.equilibrium.state) @ problem.model.output_vector
        wrong = trace.estimates.mean(axis=1) - target.mean() - moved
        size = np.abs(moved)
        error = line.slope_error
        allowed = bound.max() * (target.mean() + (1 + error) * size) + error * size
        assert np.all(np.abs(wrong) <= allowed)
        assert np.abs(wrong).max() > 0.3 * allowed.min()


@pytest.mark.ensemble
def test_random_starts_within_the_reach_stay_within_what_is_promised_from_there(wall, design):
    h = 0.9 * design.figures.h_certified
    random = np.random.default_rng(2)
    short = wall.replace(duration=1.5, event_threshold=h)
    for _ in range(3):
        moved = random.uniform(-0.05, 0.05, 2)
        start = wall.equilibrium.state + moved
        given = short.replace(initial_state=start.tolist())
        own = design_from_scenario(given)
        from_start = held_from(own.problem, own.controller, h, start=moved)
        assert np.isfinite(from_start.error)
        trace = traced(given, own)
        errors = np.linalg.norm(trace.states - wall.equilibrium.state, axis=1)
        assert errors.max() <= from_start.error
        assert errors[len(errors) // 2 :].max() < wall.objective.tolerance


def test_the_compiled_loop_leaves_profiles_to_the_nodes_cores(wall, design):
    assert compiled_loop(wall.replace(duration=5.0), design) is None
    run = run_sampled(wall.replace(duration=0.05))
    assert not run.compiled


def test_the_exact_simulation_refuses_a_profile_by_name(wall, design):
    with pytest.raises(ParameterError, match='is not simulated exactly'):
        ClosedLoop.from_scenario(wall, design.controller)


def test_a_run_beyond_the_reach_is_promised_nothing(wall):
    near = wall.replace(profile_reach=0.045, duration=0.3)
    design = design_from_scenario(near)
    verdict = judged(traced(near, design), near, design)

    assert near.sensor.event_threshold <= design.figures.h_certified
    assert verdict.cycles_beyond_profile > 0 and not verdict.certified
    assert verdict.promise == 'nothing promised: beyond profile_reach'
    assert 'left, or its profile_reach' in str(verdict)
