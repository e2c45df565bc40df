"""Figures of designs against the paper and closed forms, and what is refused."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import design_controller, design_from_scenario, measure
from dvs_hinf_controller.design.design_tool import with_pixels
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.methods import METHODS
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError

Make = Callable[..., DesignProblem]


def test_unstructured_meets_the_paper(paper_problem: Make) -> None:
    """Must hold 1, default settings."""
    figures = design_controller(paper_problem(3), method='unstructured').figures
    assert figures.gamma == pytest.approx(1.9567, rel=2e-3)
    assert figures.h_star == pytest.approx(0.15622, rel=5e-3)
    assert figures.h_star == pytest.approx(0.1562, rel=1e-2)
    assert figures.small_gain_ok
    assert figures.max_sampling_period > 4e-3


@pytest.mark.parametrize(
    ('r', 'optimum', 'printed'), [(1, 0.15101, 0.1511), (3, 0.15023, 0.1510), (9, 0.14984, 0.1508)]
)
def test_structured_meets_the_paper(
    paper_problem: Make, r: int, optimum: float, printed: float
) -> None:
    """Must hold 1, default settings."""
    figures = design_controller(paper_problem(r), method='structured').figures
    assert figures.mu_upper == pytest.approx(2.3860, rel=5e-3)
    assert 0.98 * figures.mu_upper <= figures.mu_lower <= figures.mu_upper
    assert figures.h_star == pytest.approx(optimum, rel=5e-3)
    assert figures.h_star == pytest.approx(printed, rel=1e-2)


def test_pixels_change_thresholds_and_not_the_controller(paper_problem: Make) -> None:
    one, nine = (
        design_controller(paper_problem(r), method='unstructured').controller for r in (1, 9)
    )
    np.testing.assert_array_equal(one.state_matrix, nine.state_matrix)


def test_figures_of_a_static_gain_are_closed_forms(
    problem_of: Callable[[PlantModel], DesignProblem],
) -> None:
    # x' = x + u, u = -4 (x + w): G = T = -4 / (s + 3).
    model = PlantModel(
        state_matrix=np.ones((1, 1)), input_matrix=np.ones((1, 1)), output_vector=np.ones(1)
    )
    k = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.array([-4.0]),
    )
    figures = measure(problem_of(model), k)
    assert figures.gamma == pytest.approx(math.sqrt(2) * 4 / 3, rel=1e-6)
    assert figures.mu_upper == pytest.approx(8 / 3, rel=1e-3)
    assert figures.dc_gain_w1 == figures.dc_gain_w2 == pytest.approx(4 / 3)
    assert figures.delta_star == pytest.approx(0.05 / (4 / 3 * 1.05))
    assert figures.delta_certified == pytest.approx(figures.delta_star, rel=5e-4)
    assert figures.delta_certified <= figures.delta_star
    assert figures.closed_loop_abscissa == pytest.approx(-3)
    assert figures.controller_order == 0
    assert figures.fastest_pole == 0


def test_destabilizing_controller_has_no_figures(paper_problem: Make) -> None:
    k = LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.zeros(1),
    )
    with pytest.raises(SynthesisError, match='closed-loop pole has real part 5'):
        measure(paper_problem(1), k)


@pytest.mark.parametrize('method', METHODS)
def test_unstabilizable_plant_is_named_by_every_method(method: str, problem_of: Callable) -> None:
    model = PlantModel(
        state_matrix=np.diag([1.0, -1.0]),
        input_matrix=np.array([[0.0], [1.0]]),
        output_vector=np.ones(2),
    )
    with pytest.raises(SynthesisError, match='stabilizability'):
        design_controller(problem_of(model), method=method)
    dual = PlantModel(
        state_matrix=np.diag([1.0, -1.0]),
        input_matrix=np.ones((2, 1)),
        output_vector=np.array([0.0, 1.0]),
    )
    with pytest.raises(SynthesisError, match='detectability'):
        design_controller(problem_of(dual), method=method)


def test_unknown_method_lists_the_known(paper_problem: Make) -> None:
    with pytest.raises(ParameterError, match='unstructured, structured, certified'):
        design_controller(paper_problem(1), method='lqg')


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('gamma_slack', 0.0),
        ('gamma_slack', math.nan),
        ('bandwidth_limit', -1.0),
        ('bandwidth_limit', math.inf),
        ('process_noise', 0.0),
    ],
)
def test_options_name_what_is_wrong(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        DesignOptions(**{name: value})


@pytest.mark.parametrize('method', ['unstructured', 'structured'])
def test_bandwidth_limit_caps_the_control_effort(paper_problem: Make, method: str) -> None:
    """The cost on u keeps ``sup |u/w|`` below about ``||G|| bandwidth / ||B||``."""
    free = design_controller(paper_problem(1), method=method)
    slow = design_controller(
        paper_problem(1), method=method, options=DesignOptions(bandwidth_limit=20.0)
    )
    w = np.geomspace(0.1, 1e5, 400)
    efforts = []
    for design in (free, slow):
        model = design.problem.model
        t = state_response(model, design.controller).response(w)[:, :, 0] @ model.output_vector
        efforts.append(np.abs(design.controller.response(w)[:, 0] * (1 + t)).max())
    assert efforts[1] <= slow.figures.mu_upper * 20.0 / math.sqrt(2)
    assert efforts[1] < 0.85 * efforts[0]
    assert slow.figures.gamma > free.figures.gamma
    assert slow.figures.closed_loop_abscissa < 0


def test_a_megapixel_changes_no_norm() -> None:
    scenario = Scenario.from_values({'method': 'unstructured'})
    many = design_from_scenario(with_pixels(scenario, '720x1280')).figures
    few = design_from_scenario(scenario).figures
    assert many.pixels == 921600
    assert many.gamma == pytest.approx(few.gamma)
