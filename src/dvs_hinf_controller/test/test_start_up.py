"""What the controller says when it starts: the figures of its design, and what it warns of."""

import dataclasses
import math

import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.design.start_up import darkness_warnings, start_up_report
from dvs_hinf_controller.problem import DesignProblem


@pytest.fixture(scope='module')
def design():
    return design_from_scenario(Scenario.from_values({'gamma_slack': 0.1}))


def report(design, *, threshold=0.01, period=1e-4, **figures):
    changed = dataclasses.replace(
        design,
        figures=dataclasses.replace(design.figures, **figures) if figures else design.figures,
    )
    budget = Budget.at_start(design.problem.bounds, threshold, changed.figures.delta_certified)
    return start_up_report(
        changed, event_threshold=threshold, sampling_period=period, budget=budget
    )


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


def test_nothing_is_warned_of_below_the_bounds(design):
    certified = design.figures.h_certified
    nyquist = 3.14 / design.figures.fastest_pole

    assert nyquist < design.figures.max_sampling_period
    assert report(design, threshold=certified, period=nyquist).warnings == ()


def test_a_threshold_beyond_h_certified_is_warned_of(design):
    warnings = report(design, threshold=design.figures.h_certified * 1.001).warnings

    assert len(warnings) == 1
    assert 'exceeds h_certified = ' in warnings[0]


def test_a_threshold_beyond_h_star_is_warned_of(design):
    warnings = report(design, threshold=design.figures.h_star * 1.001).warnings

    assert len(warnings) == 1
    assert 'nothing is promised' in warnings[0] and 'exceeds h* = ' in warnings[0]


def test_a_promise_beyond_what_is_published_is_not_warned_of(design):
    promised = design.figures.h_star * 1.1

    assert (
        report(design, threshold=design.figures.h_star * 1.01, h_certified=promised).warnings == ()
    )


def test_the_block_names_what_the_promise_covers_and_what_it_does_not(design):
    text = report(design).text

    assert (
        'the promise covers: continuous loop; commands held for 1 ms; camera interpolates' in text
    )
    assert 'and not: noise events, lost messages' in text


def test_a_sampling_period_beyond_the_longest_is_warned_of(design):
    warnings = report(design, period=1.001e-3, max_sampling_period=1e-3).warnings

    assert len(warnings) == 1
    assert 'at sampling_period = 0.001001 s the loop is unstable' in warnings[0]


@pytest.mark.parametrize(('holds', 'word'), [(True, 'yes'), (False, 'NO')])
def test_the_small_gain_condition_is_answered(design, holds, word):
    found = rows(report(design, small_gain_ok=holds).text)

    assert found['small gain, delta* ||Gw1||_inf < 1'] == word


def test_a_dark_set_point_has_no_promise():
    dark = Scenario.from_values({'set_point': [0.0, 0.0]})
    problem = DesignProblem.from_scenario(dark)

    (warning,) = darkness_warnings(problem, 'log')

    assert warning.startswith('pixel 2 has the luminosity -0.008')
    assert darkness_warnings(problem, 'signed_log') == ()
    assert darkness_warnings(DesignProblem.from_scenario(Scenario.from_values({})), 'log') == ()


def test_a_pole_beyond_what_the_sampling_allows_names_the_parameters_that_slow_it(design):
    fast = report(design, period=1e-3, fastest_pole=5300.0).warnings
    slow = report(design, period=1e-3, fastest_pole=3100.0).warnings

    assert [warning for warning in fast if warning not in slow] == [
        'the fastest pole of the controller, 5300 rad/s, lies beyond pi / sampling_period = '
        '3142 rad/s: a larger gamma_slack with a lower bandwidth_limit slows it down'
    ]


def test_no_feedback_at_all_is_warned_of(design):
    assert 'no feedback at all' in report(design, state_peak_gain=0.0).warnings[0]
