import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.analysis.thresholds import (
    event_threshold,
    published_uncertainty,
    small_gain_holds,
)
from dvs_hinf_controller.problem import DesignProblem

Make = Callable[..., DesignProblem]


@pytest.mark.parametrize(
    ('r', 'gain', 'wanted'),
    [(3, 1.38359, 0.15622), (1, 1.43356, 0.15101), (3, 1.43356, 0.15023), (9, 1.43356, 0.14984)],
)
def test_published_threshold_of_the_paper(
    paper_problem: Make, r: int, gain: float, wanted: float
) -> None:
    """Table of the theory page; ||c|| = 1, so that both gains are ||G(0)||."""
    problem = paper_problem(r)
    delta = published_uncertainty(problem, dc_gain_w1=gain, dc_gain_w2=gain)
    assert event_threshold(problem, delta) == pytest.approx(wanted, abs=4e-5)


@pytest.mark.parametrize(('r', 'wanted'), [(1, 0.15884), (3, 0.15864), (9, 0.15857)])
def test_published_threshold_of_the_mirror(paper_problem: Make, r: int, wanted: float) -> None:
    problem = paper_problem(r, mirror=True)
    delta = published_uncertainty(problem, dc_gain_w1=1.43356, dc_gain_w2=1.43356)
    assert event_threshold(problem, delta) == pytest.approx(wanted, abs=4e-5)


def test_threshold_is_where_the_sector_reaches_the_uncertainty(paper_problem: Make) -> None:
    """Lemma 4 and Theorem 2 are inverse to each other, in every base."""
    for log_base in (2.0, math.e, 10.0):
        problem = paper_problem(9, log_base=log_base)
        h = event_threshold(problem, 0.16)
        constants = sector(problem.bounds, event_threshold=h, log_base=log_base)
        assert constants.error_bound.max() == pytest.approx(0.16, rel=1e-12)


def test_known_reference_needs_no_reserve(paper_problem: Make) -> None:
    problem = paper_problem(1)
    known = dataclasses.replace(
        problem, bounds=ReferenceBounds(lower=np.ones(1), upper=np.ones(1))
    )
    assert event_threshold(known, 0.2) == pytest.approx(math.atanh(0.2))
    assert event_threshold(known, 0.2) > event_threshold(problem, 0.2)


def test_too_poor_a_reference_leaves_no_threshold(paper_problem: Make) -> None:
    poor = dataclasses.replace(
        paper_problem(1), bounds=ReferenceBounds(lower=np.array([0.5]), upper=np.ones(1))
    )
    assert event_threshold(poor, 0.1) < 0


def test_a_loop_without_feedback_bears_any_uncertainty(paper_problem: Make) -> None:
    problem = paper_problem(1)
    delta = published_uncertainty(problem, dc_gain_w1=0.0, dc_gain_w2=0.0)
    assert delta == math.inf
    assert event_threshold(problem, delta) == math.inf
    assert small_gain_holds(delta, 0.5)
    assert not small_gain_holds(delta, 1.0)


def test_small_gain_is_checked_at_the_peak() -> None:
    assert small_gain_holds(0.2, 4.9)
    assert not small_gain_holds(0.2, 5.1)


def test_the_mean_luminosity_is_that_of_the_set_point(paper_problem: Make) -> None:
    problem = paper_problem(9)
    assert problem.mean_luminosity == pytest.approx(np.mean(np.abs(problem.set_point_luminosity)))


@pytest.mark.parametrize(
    ('field', 'value'), [('tolerance', 0.0), ('tolerance', math.inf), ('log_base', 1.0)]
)
def test_problem_names_what_is_wrong(paper_problem: Make, field: str, value: float) -> None:
    with pytest.raises(ParameterError, match=field):
        dataclasses.replace(paper_problem(1), **{field: value})
    with pytest.raises(ParameterError, match='reference_lower'):
        dataclasses.replace(paper_problem(1), bounds=paper_problem(3).bounds)
