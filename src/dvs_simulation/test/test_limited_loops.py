"""Loops whose command, or its rate, is limited: they regulate as the free one does."""

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import parse_command, parse_state
from dvs_hinf_controller.running.command_limiter import CommandLimiter
from dvs_simulation.sampled.sampled_loop import run_sampled

PERIOD = 0.005
LOOP = Scenario.from_values({'duration': 3.0, 'sampling_period': PERIOD})


def commands_of(run):
    return np.array([parse_command(m).values for m in run.messages['command']])


def final_error(run):
    state = parse_state(run.messages['state'][-1]).values
    return float(np.linalg.norm(state - run.design.problem.equilibrium.state))


def test_a_limit_that_is_never_reached_changes_no_bit():
    assert run_sampled(LOOP.replace(command_limit=[1e6])).messages == run_sampled(LOOP).messages


def test_a_saturated_loop_regulates():
    limited = run_sampled(LOOP.replace(command_limit=[5.5]))

    assert np.abs(commands_of(limited)).max() == 5.5
    assert final_error(limited) < LOOP.objective.tolerance


def test_a_slow_actuator_is_asked_for_no_more_than_its_rate_and_regulates():
    slowed = run_sampled(LOOP.replace(command_rate_limit=[150.0]))

    steps = np.abs(np.diff(commands_of(slowed), axis=0))
    assert steps.max() == pytest.approx(150.0 * PERIOD)
    assert final_error(slowed) < LOOP.objective.tolerance


def test_without_anti_windup_the_same_actuator_leads_to_a_luminosity_that_is_not_positive(
    monkeypatch,
):
    monkeypatch.setattr(CommandLimiter, 'advance', lambda *_: None)

    with pytest.raises(ValueError, match='leads to the luminosity'):
        run_sampled(LOOP.replace(command_rate_limit=[150.0]))


def test_a_slow_plant_spends_its_limits_on_catching_up():
    """A share of 0.1, right for a plant that grows at 5/s, would leave it outside for 8 s."""
    slow = Scenario.from_values(
        {
            'state_matrix': [0.1],
            'input_matrix': [1.0],
            'output_vector': [1.0],
            'pixel_offsets': [1.5],
            'pixel_grid': [1, 1],
            'initial_state': [0.3],
            'set_point': [0.0],
            'tolerance': 0.1,
            'event_threshold': 0.01,
            'sampling_period': 0.02,
            'duration': 3.0,
            'bandwidth_limit': 20.0,
            'reference_uncertainty': 0.001,
        }
    )
    free = run_sampled(slow)
    limited = run_sampled(slow.replace(command_limit=[0.3 * np.abs(commands_of(free)).max()]))

    assert limited.controller.limiter.limited > 3
    assert final_error(limited) < slow.objective.tolerance
