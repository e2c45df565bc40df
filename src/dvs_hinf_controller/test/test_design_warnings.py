"""Every warning of a design: a scenario that has it, and one near the border that has not."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_hinf_controller.analysis.margins import margins
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import Design, design_from_scenario, measure
from dvs_hinf_controller.design.design_report import report_text
from dvs_hinf_controller.design.design_tool import main
from dvs_hinf_controller.design.design_warnings import (
    RunningLoop,
    design_warnings,
    luminosity_warnings,
)
from dvs_hinf_controller.design.running_bounds import RunningBounds
from dvs_hinf_controller.problem import DesignProblem

CONFIG = Path(__file__).resolve().parents[3] / 'config'
Values = dict[str, Any]


@cache
def shipped(name: str) -> Scenario:
    return load_scenario(CONFIG / f'{name}.yaml')


def scenario(name: str, values: Values) -> Scenario:
    return shipped(name).replace(method='unstructured').replace(**values)


@cache
def plain(name: str) -> Design:
    return design_from_scenario(scenario(name, {}))


def warnings_of(name: str, values: Values) -> list[str]:
    here = scenario(name, values)
    design = plain(name)
    if not values.keys() <= {'event_threshold', 'command_limit', 'command_rate_limit'}:
        design = design_from_scenario(here)
    return list(design_warnings(design, RunningLoop.of_scenario(here)))


def h(name: str, figure: str, factor: float) -> Values:
    return {'event_threshold': factor * getattr(plain(name).figures, figure)}


def period(factor: float) -> Values:
    return {'sampling_period': round(factor * plain('mirror_r1').figures.max_sampling_period, 9)}


def latency(factor: float) -> Values:
    design = plain('mirror_r1')
    bearable = margins(design.problem.model, design.controller).delay
    return {'loop_latency': round(factor * bearable, 9)}


def references(factor: float) -> Values:
    """Known so poorly that the width of q(0) alone takes this share of the budget."""
    design = plain('mirror_r1')
    width = factor * math.atanh(design.figures.delta_certified)
    start = float(design.problem.model.gradient @ design.problem.initial_state)
    return {'reference_uncertainty': start * math.tanh(width)}


def bounds(factor: float, *, of_the_start: bool) -> Values:
    found = RunningBounds.of(plain('textbook/heading'), 0.07)
    held = found.from_its_start if of_the_start else found.in_the_limit
    assert held is not None
    return {'command_limit': (factor * held.commands).tolist()}


def rate(factor: float) -> Values:
    held = RunningBounds.of(plain('textbook/heading'), 0.07).from_its_start
    assert held is not None
    return {'command_rate_limit': (factor * 2e3 * held.commands).tolist()}


STABLE = {
    'state_matrix': [-1.0, 1.0, 0.0, -2.0],
    'input_matrix': [0.0, 1.0],
    'output_vector': [1.0, 0.0],
    'pixel_offsets': [1.0, 0.0],
    'initial_state': [0.2, 0.0],
    'set_point': [0.0, 0.0],
    'pixel_grid': [1, 1],
    'tolerance': 0.1,
    'event_threshold': 0.02,
}
COUNTED = {'model_uncertainty': 0.01, 'disturbance_bound': [0.01]}

CASES: list[tuple[str, str, Callable[[], Values], Callable[[], Values]]] = [
    (
        'mirror_r1',
        'exceeds h_certified = ',
        lambda: h('mirror_r1', 'h_certified', 1.001),
        lambda: h('mirror_r1', 'h_certified', 1.0),
    ),
    (
        'mirror_r1',
        'nor published (it exceeds h* = ',
        lambda: h('mirror_r1', 'h_star', 1.001),
        lambda: h('mirror_r1', 'h_star', 1.0),
    ),
    (
        'textbook/cart_pole',
        'nor does h* apply: the small-gain condition',
        dict,
        # The same design, where the threshold exceeds h* besides.
        lambda: {'event_threshold': 0.35},
    ),
    (
        'mirror_r1',
        'is not certified, and no other is',
        lambda: references(1.01),
        lambda: references(0.99),
    ),
    (
        'textbook/heading',
        'certified found no controller with a promise at any threshold',
        lambda: {'method': 'certified', 'disturbance_bound': [30.0]},
        lambda: {'method': 'certified', 'disturbance_bound': [0.3]},
    ),
    (
        'real_sensor',
        'only as long as the certificate on /diagnostics',
        dict,
        lambda: {'threshold_uncertainty': [0.01], 'leak_uncertainty': 0.0},
    ),
    (
        'mirror_r1',
        'not covered: threshold_uncertainty',
        lambda: {'threshold_uncertainty': [0.01]},
        lambda: {'threshold_uncertainty': [0.01], 'anchor_period': 0.04},
    ),
    (
        'mirror_r1',
        'not covered: threshold_uncertainty or leak_uncertainty',
        lambda: {'leak_uncertainty': 0.01},
        lambda: {'latency_uncertainty': 1e-3},
    ),
    (
        'mirror_r1',
        'next to no feedback, an error of 100 % moves the state by',
        lambda: STABLE,
        lambda: {**STABLE, **COUNTED},
    ),
    (
        'mirror_r1',
        'next to no feedback',
        lambda: {**STABLE, 'model_uncertainty': 0.01},
        lambda: {**STABLE, 'settling_time': 2.0},
    ),
    (
        # A tolerance that is large does not make a small feedback of one that holds the plant.
        'mirror_r1',
        'next to no feedback',
        lambda: {**STABLE, 'tolerance': 1e3},
        lambda: {'tolerance': 1e3},
    ),
    (
        'textbook/flexible_mode',
        'next to no feedback',
        lambda: {'settling_time': 0.0},
        lambda: {'settling_time': 20.0},
    ),
    (
        'mirror_r1',
        'the loop is unstable without any error',
        lambda: period(1.01),
        lambda: period(0.99),
    ),
    (
        'mirror_r1',
        's and loop_latency = ',
        # A command that is held is half a period late besides.
        lambda: latency(1.01),
        lambda: latency(0.95),
    ),
    (
        'textbook/cart_pole',
        'the fastest pole of the controller',
        dict,
        lambda: {'gamma_slack': 0.1, 'bandwidth_limit': 30.0},
    ),
    (
        # The pole of the current is faster yet, and the promise counts it.
        'textbook/dc_motor',
        'the fastest pole of the controller',
        lambda: h('textbook/dc_motor', 'h_certified', 1.01),
        dict,
    ),
    (
        'textbook/heading',
        'may be reached in the limit',
        lambda: bounds(0.999, of_the_start=False),
        lambda: bounds(1.001, of_the_start=False),
    ),
    (
        'textbook/heading',
        'command_limit = ',
        lambda: bounds(0.999, of_the_start=True),
        lambda: bounds(1.001, of_the_start=True),
    ),
    ('textbook/heading', 'command_rate_limit = ', lambda: rate(0.999), lambda: rate(1.001)),
]


def marked(case: tuple) -> object:
    return pytest.param(*case, marks=[pytest.mark.ensemble] * case[1].startswith('certified'))


@pytest.mark.parametrize(('name', 'words', 'there', 'not_there'), [marked(case) for case in CASES])
def test_a_warning_appears_where_it_must_and_not_beyond_its_border(name, words, there, not_there):
    def count(values: Values) -> int:
        return sum(words in warning for warning in warnings_of(name, values))

    assert count(there()) == 1
    assert count(not_there()) == 0


@pytest.mark.parametrize('name', ['textbook/heading', 'textbook/dc_motor'])
def test_within_its_promise_a_scenario_has_no_warning(name):
    assert warnings_of(name, {}) == []


def test_no_feedback_at_all_is_not_taken_for_next_to_none():
    problem = DesignProblem.from_scenario(Scenario.from_values(STABLE))
    nothing = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.zeros(1),
    )
    design = Design(
        method='file', problem=problem, controller=nothing, figures=measure(problem, nothing)
    )
    (warning,) = design_warnings(design, RunningLoop.of_scenario(Scenario.from_values(STABLE)))

    assert warning.startswith('no feedback at all, u is constant')
    assert 'no feedback' in report_text([design], event_threshold=0.02)


def test_a_threshold_between_h_certified_and_h_star_has_one_warning():
    figures = plain('mirror_r1').figures
    (warning,) = warnings_of('mirror_r1', {})

    assert figures.h_certified < 0.15 < figures.h_star
    assert warning.endswith('nothing is promised for the loop that runs')


def test_a_pixel_without_light_at_the_set_point_is_named():
    def found(values: Values, photoreceptor: str = 'log') -> tuple[str, ...]:
        return luminosity_warnings(
            DesignProblem.from_scenario(base.replace(**values)), photoreceptor
        )

    base = Scenario.from_values({'set_point_tolerance': 10.0})
    (warning,) = found({'set_point': [0.0, 0.0]})

    assert warning.startswith('pixel 2 has the luminosity -0.008')
    assert found({'set_point': [0.0, 0.0]}, 'signed_log') == ()
    # Its set-point luminosity is c'x_d - 0.00894.
    assert len(found({'set_point': [0.0124, -0.005]})) == 1
    assert found({'set_point': [0.0126, -0.005]}) == ()


def no_constant(name: str) -> None:
    raise AssertionError(f'{name} is no JSON')


@pytest.mark.parametrize(
    'values',
    [STABLE, {**STABLE, 'method': 'structured'}, {'threshold_uncertainty': [0.1]}, {}],
)
def test_json_has_what_the_text_has_in_numbers_that_json_has(values, tmp_path, capsys):
    file = tmp_path / 'scenario.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': values}}))

    assert main(['--params-file', str(file), '--json']) == 0

    given = capsys.readouterr()
    found = json.loads(given.out, parse_constant=no_constant)
    assert [f'warning: {found["method"]}: {text}' for text in found['warnings']] == (
        given.err.splitlines()
    )
    any_threshold = 'h_certified' in found['unlimited']
    assert (found['h_certified'] is None) == any_threshold
    assert [cost['threshold'] is None for cost in found['costs']] == (
        [cost['part'] in found['unlimited'] for cost in found['costs']]
    )
    assert found['light_stays_on'] == (found['from_its_start']['error'] is not None)
    assert (found['in_the_limit']['error'] is None) == bool(values.get('threshold_uncertainty'))


@pytest.mark.ensemble
def test_bounds_and_figures_are_those_of_the_pixels_that_are_used(tmp_path, capsys):
    """A pixel without light that is masked changes nothing."""
    values = {'set_point': [0.0124, -0.005], 'set_point_tolerance': 1.0, 'event_threshold': 1e-3}
    files = {}
    for name, mask in (('all', []), ('used', [2])):
        files[name] = tmp_path / f'{name}.yaml'
        given = {**values, **({'pixel_mask': mask} if mask else {})}
        files[name].write_text(json.dumps({'/**': {'ros__parameters': given}}))
    warned = {}
    for name, file in files.items():
        assert main(['--params-file', str(file), '--json']) == 0
        warned[name] = json.loads(capsys.readouterr().out)['warnings']

    assert any('pixel 2 has the luminosity' in text for text in warned['all'])
    assert not any('has the luminosity' in text for text in warned['used'])


def test_the_mean_of_the_bounds_is_that_of_the_tolerance_at_the_certified_threshold():
    design = plain('mirror_r1')
    found = RunningBounds.of(design, design.figures.h_certified)

    assert found.in_the_limit.error == pytest.approx(design.problem.tolerance, rel=1e-4)
    assert np.all(np.isfinite(found.in_the_limit.commands))
    assert RunningBounds.of(design, 2.0).in_the_limit.error == math.inf
