"""What the controller logs when it starts: the figures of its design, and what it warns of."""

import dataclasses
import math

import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.design.design_warnings import RunningLoop
from dvs_hinf_controller.design.start_up import start_up_report

PERIOD = 'nominal loop stable up to a sampling_period of (no promise of eps)'


@pytest.fixture(scope='module')
def design():
    return design_from_scenario(Scenario.from_values({'gamma_slack': 0.1}))


def report(design, *, threshold=0.01, **figures):
    changed = dataclasses.replace(
        design,
        figures=dataclasses.replace(design.figures, **figures) if figures else design.figures,
    )
    budget = Budget.at_start(design.problem.bounds, threshold, changed.figures.delta_certified)
    loop = RunningLoop.of_scenario(Scenario.from_values({'event_threshold': threshold}))
    return start_up_report(changed, loop, budget=budget)


def rows(text):
    lines = text.splitlines()[1:-2]
    return {line[2:].rsplit('  ', 1)[0].strip(): line.rsplit('  ', 1)[1] for line in lines}


def test_the_figures_of_the_design_are_named(design):
    found = rows(report(design, threshold=0.15).text)
    figures = design.figures

    assert found['pixels r'] == '3'
    assert found['event threshold h'] == '0.15'
    assert float(found['||Gw1(0)||']) == pytest.approx(figures.dc_gain_w1, rel=1e-5)
    assert float(found['||Gw2(0)||']) == pytest.approx(figures.dc_gain_w2, rel=1e-5)
    assert float(found['||Gw1||_inf']) == pytest.approx(figures.hinf_gain_w1, rel=1e-5)
    assert float(found['delta*']) == pytest.approx(figures.delta_star, rel=1e-5)
    assert float(found['h* (published)']) == pytest.approx(figures.h_star, rel=1e-5)


def test_the_budget_of_the_start_is_in_the_block(design):
    within, beyond = (rows(report(design, threshold=h).text) for h in (0.01, 0.15))
    allowed = math.atanh(design.figures.delta_certified)
    bounds = design.problem.bounds
    width = 0.5 * math.log((bounds.upper / bounds.lower).max())

    assert float(within['atanh(delta_certified)']) == pytest.approx(allowed, rel=1e-5)
    assert float(beyond['h ln b + max w']) == pytest.approx(0.15 + width, rel=1e-3)
    assert (within['certificate'], beyond['certificate']) == ('certified now', 'not certified')


def test_the_sector_is_that_of_the_running_threshold(design):
    coarse, fine = (rows(report(design, threshold=h).text) for h in (0.15, 0.05))

    assert float(coarse['sector bound delta_z']) > float(fine['sector bound delta_z'])


def test_the_block_names_what_the_promise_covers_and_what_it_does_not(design):
    text = report(design).text

    assert (
        'the promise covers: continuous loop; commands held for 1 ms; camera interpolates' in text
    )
    assert 'and not: noise events, lost messages' in text


@pytest.mark.parametrize(('holds', 'word'), [(True, 'yes'), (False, 'NO')])
def test_the_small_gain_condition_is_answered(design, holds, word):
    found = rows(report(design, small_gain_ok=holds).text)

    assert found['small gain, delta* ||Gw1||_inf < 1'] == word


@pytest.mark.parametrize(
    ('changes', 'row', 'words'),
    [
        ({'h_certified': math.inf}, 'h_certified (guaranteed)', 'any'),
        ({'h_certified': -math.inf}, 'h_certified (guaranteed)', 'none'),
        ({'h_certified': -0.001}, 'h_certified (guaranteed)', 'none'),
        ({'h_certified': 0.1}, 'h_certified (guaranteed)', '0.1'),
        ({'max_sampling_period': math.inf}, PERIOD, 'any ms'),
        ({'max_sampling_period': 0.0123}, PERIOD, '12.3 ms'),
    ],
)
def test_what_has_no_number_is_a_word(design, changes, row, words):
    assert rows(report(design, **changes).text)[row] == words
