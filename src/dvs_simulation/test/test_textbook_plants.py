"""Five textbook plants: the shipped scenario is within its promise, and the run keeps it."""

from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import judge
from dvs_simulation.sampled.sampled_loop import run_sampled

pytestmark = pytest.mark.ensemble

FOLDER = Path(__file__).resolve().parents[3] / 'config' / 'textbook'
PLANTS = sorted(file.stem for file in FOLDER.glob('*.yaml'))
# What the best of the families of `certified` reaches.
LEAST = {'ball_and_beam': 0.09, 'cart_pole': 0.053}
SLOW = ('ball_and_beam', 'cart_pole', 'dc_motor')


def scenario(name):
    return load_scenario(FOLDER / f'{name}.yaml')


def verdict(parameters):
    run = run_sampled(parameters)
    trace = decode_trace(run.messages)
    return judge(
        trace,
        parameters,
        name='test',
        promised=Promised.of(run.design),
        wall_seconds=1.0,
        interrupted=False,
    )


def test_there_are_five_textbook_plants():
    assert len(PLANTS) == 5


@pytest.mark.filterwarnings('error::RuntimeWarning')
@pytest.mark.parametrize('name', PLANTS)
def test_the_run_of_a_textbook_plant_keeps_what_is_promised(name):
    found = verdict(scenario(name))

    assert found.certified
    assert found.regulated and found.sector_held
    assert not found.settling
    assert 0.5 * found.h_certified < found.h < found.h_certified
    assert found.h_certified >= LEAST.get(name, 0.0)


@pytest.mark.parametrize(
    'name',
    [pytest.param(p, marks=pytest.mark.long) if p in SLOW else p for p in PLANTS],
)
def test_certified_is_the_best_column(name):
    thresholds = {
        method: design_from_scenario(scenario(name).replace(method=method)).figures.h_certified
        for method in ('unstructured', 'structured', 'certified')
    }

    assert max(thresholds.values()) == thresholds['certified'] > 0


def test_a_run_that_ends_too_early_did_not_settle_and_one_with_a_coarse_threshold_left_eps():
    slow = scenario('heading').replace(method='structured', settling_time=0.0)
    early = verdict(slow.replace(duration=3.0))
    fast = scenario('heading').replace(method='structured', initial_state=(0.2,), duration=3.0)
    coarse = verdict(fast.replace(event_threshold=0.4))

    assert early.settling and 'did not settle yet' in str(early)
    assert not coarse.regulated and not coarse.settling
    assert 'left eps' in str(coarse) and 'nothing promised' in str(coarse)


def test_a_command_at_its_limit_is_no_part_of_the_promise():
    limited = scenario('heading').replace(method='structured', command_limit=(0.01,), duration=0.5)
    found = verdict(limited)

    assert found.saturated_cycles > 20
    assert not found.certified
    assert 'command              at its limit in' in str(found)


def test_a_settling_time_bounds_the_slowest_pole():
    for method in ('unstructured', 'structured'):
        found = design_from_scenario(scenario('heading').replace(method=method)).figures
        assert found.closed_loop_abscissa <= -np.log(50) / 6.0
