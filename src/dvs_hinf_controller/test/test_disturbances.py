"""Weights, settling time, constant disturbances and integral action: asked, designed, measured."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_hinf_controller.analysis.promise import Promise
from dvs_hinf_controller.analysis.static_gains import StaticGains
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.design.pareto import ParetoPoint, pareto
from dvs_hinf_controller.design.pareto_figure import COLUMNS, save_pareto
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors
from dvs_hinf_controller.synthesis.options import DesignOptions

ROOT = Path(__file__).resolve().parents[3]
MIRROR = load_scenario(ROOT / 'config' / 'mirror_r1.yaml').replace(method='structured')


@pytest.fixture(scope='module')
def plain():
    return design_from_scenario(MIRROR)


def test_weights_scale_the_error_as_a_change_of_units_does(plain):
    # ||W x|| with W = 2 I and twice the tolerance is the same question.
    doubled = design_from_scenario(MIRROR.replace(error_weights=(2.0, 2.0), tolerance=0.1))

    assert doubled.figures.h_certified == pytest.approx(plain.figures.h_certified, rel=1e-9)
    assert doubled.figures.h_star == pytest.approx(plain.figures.h_star, rel=1e-9)


def test_a_free_state_leaves_more_to_the_threshold_and_states_keep_their_own_bounds(plain):
    free = design_from_scenario(MIRROR.replace(error_weights=(1.0, 0.0)))
    sectors = Sectors.common(0.1)

    def held(design):
        return Promise(design.problem, plain.controller, design.problem.operation).held(sectors)

    assert free.figures.h_certified > plain.figures.h_certified
    assert held(free).error < held(plain).error
    assert held(free).output == pytest.approx(held(plain).output)


def test_weights_do_not_hide_what_an_error_of_the_plant_does():
    uncertain = {'model_uncertainty': 0.01}
    weighted = design_from_scenario(MIRROR.replace(error_weights=(1.0, 1.0), **uncertain))
    unweighted = design_from_scenario(MIRROR.replace(**uncertain))

    assert weighted.figures.h_certified == pytest.approx(unweighted.figures.h_certified, rel=1e-6)


@pytest.mark.parametrize(
    ('weights', 'rule'), [((1.0,), 'must have 0 or 2 entries'), ((0.0, 0.0), 'must not all be 0')]
)
def test_weights_that_make_no_sense_are_refused(weights, rule):
    with pytest.raises(ParameterError, match=rule):
        DesignProblem.from_scenario(MIRROR.replace(error_weights=weights))


def test_the_tolerance_of_the_output_is_part_of_the_promise(plain):
    tight = design_from_scenario(MIRROR.replace(output_tolerance=0.005))

    assert tight.figures.h_certified < plain.figures.h_certified


def test_a_settling_time_that_a_mode_can_not_keep_is_refused_by_name():
    scenario = Scenario.from_values(
        {
            'state_matrix': [1.0, 0.0, 0.0, -0.1],
            'input_matrix': [1.0, 0.0],
            'output_vector': [1.0, 1.0],
            'set_point': [0.0, 0.0],
            'settling_time': 4.0,
            'pixel_offsets': [1.0, 0.0],
            'pixel_grid': [1, 1],
        }
    )
    with pytest.raises(ParameterError, match='settling_time = 4'):
        design_from_scenario(scenario)


@pytest.mark.parametrize('method', ['unstructured', 'structured'])
def test_every_pole_settles_in_time(method):
    found = design_from_scenario(MIRROR.replace(method=method, settling_time=1.0))

    assert found.figures.closed_loop_abscissa <= -math.log(50)


def test_a_load_costs_its_static_response_and_nothing_with_integral_action(plain):
    load = {'constant_load_bound': (0.02,)}
    without = design_from_scenario(MIRROR.replace(**load)).figures
    with_it = design_from_scenario(MIRROR.replace(**load, integral_action=True))
    last, before = with_it.figures.costs[-1], with_it.figures.costs[-2]

    assert without.h_certified < plain.figures.h_certified
    assert last.part == 'constant load'
    assert last.threshold == pytest.approx(before.threshold, abs=1e-9)
    moved = StaticGains(with_it.problem.model, with_it.controller, None).of_load(
        with_it.problem.model.input_matrix[:, 0], 1.0
    )
    assert moved.error < 1e-6


def test_integral_action_is_refused_where_the_pixels_can_not_distinguish_the_loads():
    scenario = MIRROR.replace(
        input_matrix=(1.0, 0.0, 0.0, 1.0), integral_action=True, set_point=(0.2321, -0.0928)
    )
    with pytest.raises(ParameterError, match='integral_action'):
        design_from_scenario(scenario)
    assert DesignOptions.from_scenario(scenario).integral_action


def test_an_output_disturbance_costs_threshold(plain):
    found = design_from_scenario(MIRROR.replace(output_disturbance_bound=0.002)).figures

    assert found.costs[-1].part == 'output disturbance 0.002'
    assert found.h_certified < plain.figures.h_certified


def test_the_trade_between_h_and_bandwidth_is_a_table_and_a_figure(tmp_path):
    points = []
    for point in pareto(MIRROR.replace(method='unstructured')):
        points.append(point)
        if len(points) == 2:
            break
    points.append(
        ParetoPoint(
            parameter='loop_latency',
            value=0.1,
            h_certified=-math.inf,
            h_star=math.inf,
            fastest_pole=math.nan,
            slowest_pole=math.nan,
        )
    )
    picture = save_pareto(points, tmp_path / 'costs.csv')

    lines = (tmp_path / 'costs.csv').read_text().splitlines()
    assert lines[0] == ','.join(COLUMNS)
    assert [line.split(',')[0] for line in lines[1:]] == [point.parameter for point in points]
    assert points[0].value == 0.0005 and points[0].h_certified > points[1].h_certified
    assert picture.stat().st_size > 10_000


def test_the_promise_of_a_list_of_plants_is_that_of_the_worst(plain):
    a, b = np.array([[2.0, 10.0], [0.0, 5.0]]), np.array([[1.0], [1.0]])
    same = MIRROR.replace(further_state_matrices=tuple(a.ravel()))
    other = MIRROR.replace(
        further_state_matrices=(*a.ravel(), *(1.01 * a).ravel()),
        further_input_matrices=(*b.ravel(), *(0.99 * b).ravel()),
    )

    unchanged, changed = (design_from_scenario(scenario).figures for scenario in (same, other))
    assert unchanged.h_certified == pytest.approx(plain.figures.h_certified, rel=1e-6)
    assert changed.h_certified < plain.figures.h_certified
    assert changed.costs[-1].part == '2 further plants'


def test_a_plant_that_the_controller_does_not_hold_leaves_no_promise():
    backwards = MIRROR.replace(further_input_matrices=(-1.0, -1.0))

    assert design_from_scenario(backwards).figures.h_certified == -math.inf


def test_a_further_plant_settles_at_the_equilibrium_of_its_own_equations(plain):
    a, b = np.array([[2.02, 10.0], [0.0, 5.0]]), np.array([[1.0], [1.0]])
    held = plain.problem.equilibrium
    drift = a @ held.state + b @ held.feedforward
    loop = dataclasses.replace(plain.problem.model, state_matrix=a)
    moved = StaticGains(loop, plain.controller, None).of_drive(drift)

    k = plain.controller
    c = loop.output_vector[None, :]
    whole = np.block(
        [
            [a + b * k.feedthrough @ c, b @ k.output_matrix],
            [k.input_vector[:, None] @ c, k.state_matrix],
        ]
    )
    x = np.linalg.solve(whole, -np.concatenate([drift, np.zeros(k.order)]))[:2]
    assert moved.error == pytest.approx(float(np.linalg.norm(x)), rel=1e-6)


@pytest.mark.parametrize('name', ['further_state_matrices', 'further_input_matrices'])
def test_a_list_of_plants_of_another_size_is_refused(name):
    with pytest.raises(ParameterError, match='must have a multiple of'):
        DesignProblem.from_scenario(MIRROR.replace(**{name: (1.0, 2.0, 3.0)}))
