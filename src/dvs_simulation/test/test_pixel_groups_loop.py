"""The sampled loop of two pixel groups: its promise, and what refuses more than one."""

from functools import cache

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import parse_command, parse_state
from dvs_common.wire.topics import COMMAND, STATE
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.sampled_loop import run_by_messages
from dvs_simulation.sweep.own_plant import own_plant_study

# Two unstable axes, each seen mainly by one stripe.
STRIPES = Scenario.from_values(
    {
        'state_matrix': [0.5, 0.0, 0.0, 1.0],
        'input_matrix': [1.0, 0.0, 0.0, 1.0],
        'output_vector': [1.0, 0.2, -0.3, 1.0],
        'pixel_grid': [2, 2],
        'pixel_groups': [0, 1],
        'pixel_offsets': [0.9, 0.0, 1.0, 0.0, 0.0, 0.9, 0.0, 1.0],
        'initial_state': [0.1, -0.1],
        'set_point': [0.0, 0.0],
        'tolerance': 0.2,
        'reference_uncertainty': 0.002,
        'disturbance_bound': [0.01],
        'method': 'unstructured',
        'bandwidth_limit': 20.0,
        'sampling_period': 0.01,
        'duration': 12.0,
    }
)


@pytest.fixture(scope='module')
def design():
    return design_from_scenario(STRIPES)


@pytest.mark.parametrize('seed', range(4))
def test_two_groups_stay_within_their_promise(design, seed):
    generator = np.random.default_rng(seed)
    h = design.figures.h_certified
    assert h > 0.02
    start = 0.15 * np.sign(generator.standard_normal(2))
    scenario = STRIPES.replace(
        event_threshold=0.999 * h,
        initial_state=start.tolist(),
        initial_reference='random',
        seed=seed,
        constant_load=(0.01 * np.sign(generator.standard_normal(2))).tolist(),
    )
    run = run_by_messages(scenario, design=design)

    states = np.array([parse_state(message).values for message in run.messages[STATE]])
    settled = len(states) * 2 // 3
    error = np.linalg.norm(states[settled:], axis=1).max()
    assert 0.02 < error < design.problem.tolerance


@cache
def loaded(*, integral_action):
    scenario = STRIPES.replace(
        constant_load=[0.05, -0.03],
        duration=6.0,
        event_threshold=1e-3,
        method='certified',
        integral_action=integral_action,
    )
    return scenario, design_from_scenario(scenario)


def run_with_load(*, integral_action, **values):
    scenario, design = loaded(integral_action=integral_action)
    run = run_by_messages(scenario.replace(**values), design=design)
    states, commands = (
        np.array([parse(message).values for message in run.messages[topic]])
        for parse, topic in ((parse_state, STATE), (parse_command, COMMAND))
    )
    return states[len(states) * 2 // 3 :], commands


@pytest.mark.ensemble
def test_integral_action_takes_the_loads_of_two_groups_away():
    without, _ = run_with_load(integral_action=False)
    states, _ = run_with_load(integral_action=True)

    offset = np.abs(states.mean(axis=0))
    assert np.all(offset < 0.3 * np.abs(without.mean(axis=0)))
    assert np.linalg.norm(states, axis=1).max() < STRIPES.objective.tolerance


@pytest.mark.ensemble
def test_two_groups_regulate_at_the_limit_of_their_commands():
    _, free = run_with_load(integral_action=True)
    states, commands = run_with_load(integral_action=True, command_limit=[0.3])

    assert np.abs(free).max() > 0.3
    assert np.abs(commands).max() == 0.3
    assert np.linalg.norm(states, axis=1).max() < STRIPES.objective.tolerance


def test_the_loop_of_two_groups_runs_by_messages(design):
    assert compiled_loop(STRIPES, design) is None


def test_the_exact_simulation_and_its_study_refuse_two_groups_by_name(design):
    with pytest.raises(ParameterError, match='2 pixel groups; this study takes one'):
        own_plant_study(STRIPES)
    with pytest.raises(ParameterError, match='2 pixel groups; the exact simulation takes one'):
        ClosedLoop.from_scenario(STRIPES, design.controller)
