"""What acts on a run and is no part of its promise: a scenario of each, and one within bounds."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from verdict_cases import promised_of

from dvs_common.scenario.scenario import Scenario, load_scenario

CONFIG = Path(__file__).resolve().parents[3] / 'config'
SCENARIO = Scenario.from_values({'set_point_tolerance': 1.0})
ANCHORED = {'threshold_uncertainty': [0.1], 'anchor_period': 0.04}

# What the simulated world has, what the promise counts, a little less of it, and the word for it.
CASES = [
    (
        {'threshold_mismatch': 0.03},
        {'threshold_uncertainty': [0.09]},
        {'threshold_uncertainty': [0.089]},
        'threshold_mismatch',
    ),
    (
        {'event_threshold_off': 0.16},
        {'threshold_uncertainty': [0.0, 0.067]},
        {'threshold_uncertainty': [0.0, 0.066]},
        'event_threshold_off',
    ),
    ({'leak_rate': 0.1}, {'leak_uncertainty': 0.1}, {'leak_uncertainty': 0.09}, 'leak_rate'),
    (
        {'latency': 1e-3, 'jitter': 2e-4},
        {'latency_uncertainty': 2e-3},
        {'latency_uncertainty': 1.9e-3},
        'latency',
    ),
    (
        {'frame_noise': 0.01},
        {**ANCHORED, 'anchor_uncertainty': 0.03},
        {**ANCHORED, 'anchor_uncertainty': 0.029},
        'frame_noise',
    ),
    (
        {'input_disturbance': 0.02},
        {'disturbance_bound': [0.1]},
        {'disturbance_bound': [0.09]},
        'input_disturbance',
    ),
    (
        {'constant_load': [-0.2]},
        {'constant_load_bound': [0.2]},
        {'constant_load_bound': [0.19]},
        'constant_load',
    ),
    (
        {'constant_load': [0.2]},
        {'disturbance_bound': [0.2]},
        {'disturbance_bound': [0.19]},
        'constant_load',
    ),
    (
        {'output_disturbance': -0.01},
        {'output_disturbance_bound': 0.01},
        {'output_disturbance_bound': 0.009},
        'output_disturbance',
    ),
    ({'mode': 'realtime'}, {'loop_latency': 1e-3}, {}, 'loop_latency = 0'),
]
# Outside of every promise (docs/promise.md, "Not covered").
NEVER = [
    {'shot_noise_rate': 0.1},
    {'hot_pixel_fraction': 0.1},
    {'dead_pixel_fraction': 0.1},
    {'refractory_period': 1e-3},
    {'cutoff_frequency': 200.0},
    {'reset': 'level'},
    {'state_disturbance': 0.01},
    {'photoreceptor': 'lin_log'},
]


def uncovered(world, counted):
    return promised_of(SCENARIO.replace(**counted)).uncovered(SCENARIO.replace(**world))


@pytest.mark.parametrize(('world', 'counted', 'too_little', 'word'), CASES)
def test_what_acts_is_named_where_the_promise_counts_less(world, counted, too_little, word):
    assert uncovered(world, counted) == ''
    assert word in uncovered(world, too_little)
    if 'anchor_uncertainty' not in counted:  # without anchors it is not used
        assert word in uncovered(world, {})


@pytest.mark.parametrize('world', NEVER)
def test_what_no_promise_covers_is_named(world):
    assert uncovered(world, {'threshold_uncertainty': [0.9], 'leak_uncertainty': 1e3})


def test_a_preset_counts_as_what_it_gives():
    noisy = Scenario.from_values({'preset': 'noisy'})

    assert promised_of(noisy).uncovered(noisy)


def test_a_plant_that_differs_from_the_design_is_named():
    other = {'state_matrix': [2.0, 10.1, 0.0, 5.0]}

    assert 'beyond model_uncertainty' in uncovered(other, {})
    assert 'beyond model_uncertainty' in uncovered(other, {'model_uncertainty': 0.009})
    assert not uncovered(other, {'model_uncertainty': 0.01})
    assert not uncovered(other, {'further_state_matrices': other['state_matrix']})
    assert 'beyond model_uncertainty' in uncovered({'input_matrix': [1.0, 1.01]}, {})
    assert 'output_vector' in uncovered({'output_vector': [0.9, 0.45]}, {})
    assert 'set_point' in uncovered({'set_point': [0.23, -0.092]}, {})
    assert 'sampling_period' in uncovered({'sampling_period': 0.002}, {})
    assert not uncovered({'sampling_period': 5e-4}, {})


@pytest.mark.parametrize('file', sorted(CONFIG.glob('**/*.yaml')), ids=lambda file: file.stem)
def test_in_every_shipped_scenario_the_promise_counts_what_acts(file):
    if file.parent.name in ('qos', 'security') or file.stem == 'platform':
        pytest.skip('no scenario')
    scenario = load_scenario(file)
    promised = promised_of(scenario)

    expected = 'loop_latency = 0' if scenario.loop.mode == 'realtime' else ''
    assert promised.uncovered(scenario).startswith(expected)
    assert bool(promised.uncovered(scenario)) == bool(expected)


def test_without_an_operation_nothing_is_compared():
    promised = promised_of(SCENARIO)
    continuous = dataclasses.replace(promised, problem=promised.problem.continuous)

    assert continuous.uncovered(SCENARIO.replace(leak_rate=1.0)) == ''
