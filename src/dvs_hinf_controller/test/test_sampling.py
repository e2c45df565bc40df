import math

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.sampling import SampledLoop, max_sampling_period
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import synthesize_rolled_off


def static(gain: float) -> LinearController:
    return LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.array([gain]),
    )


def first_order(a: float) -> PlantModel:
    return PlantModel(
        state_matrix=np.array([[a]]), input_matrix=np.ones((1, 1)), output_vector=np.ones(1)
    )


def maps_over(model: PlantModel, controller: LinearController, period: float) -> list[np.ndarray]:
    """Maps of (x, xc) over a period, with a sensor that sees all and one that interpolates."""
    loop = SampledLoop.of(model, controller)
    flow = loop.flow_over(np.array(period))
    return [loop.map(flow), loop.interpolated_map(flow, np.array(period))]


def test_sampled_map_is_the_integrated_loop(paper_model: PlantModel) -> None:
    """Against an ODE solver: x with the held u, xc driven by c'x(t) all along."""
    controller = synthesize_rolled_off(paper_model, DesignOptions()).controller
    rng = np.random.default_rng(0)
    start = rng.standard_normal(2 + controller.order)
    u = controller.output_matrix @ start[2:] + controller.feedthrough * (
        paper_model.output_vector @ start[:2]
    )

    def flow(_: float, s: np.ndarray) -> np.ndarray:
        x, xc = s[:2], s[2:]
        return np.concatenate(
            [
                paper_model.state_matrix @ x + paper_model.input_matrix @ u,
                controller.state_matrix @ xc
                + controller.input_vector * (paper_model.output_vector @ x),
            ]
        )

    end = scipy.integrate.solve_ivp(flow, (0, 0.02), start, rtol=1e-11, atol=1e-13, method='Radau')
    seen_all_along, _ = maps_over(paper_model, controller, 0.02)
    np.testing.assert_allclose(seen_all_along @ start, end.y[:, -1], rtol=1e-7, atol=1e-8)


def test_with_a_camera_that_interpolates_k_sees_a_straight_line(paper_model: PlantModel) -> None:
    """Against an ODE solver, and K in a thousand pieces of the line."""
    controller = synthesize_rolled_off(paper_model, DesignOptions()).controller
    period, k = 0.02, controller.order
    start = np.random.default_rng(1).standard_normal(2 + k)
    a, b, c = paper_model.state_matrix, paper_model.input_matrix[:, 0], paper_model.output_vector
    u = controller.output_matrix @ start[2:] + controller.feedthrough * (c @ start[:2])
    x = scipy.integrate.solve_ivp(
        lambda _, s: a @ s + b * u, (0, period), start[:2], rtol=1e-11, atol=1e-13
    ).y[:, -1]
    seen = np.linspace(c @ start[:2], c @ x, 2001)
    flow = scipy.linalg.expm(
        np.block([[controller.state_matrix, controller.input_vector[:, None]], [np.zeros(k + 1)]])
        * (period / 1000)
    )
    xc = start[2:]
    for middle in seen[1::2]:
        xc = flow[:k, :k] @ xc + flow[:k, k] * middle

    _, interpolated = maps_over(paper_model, controller, period)
    np.testing.assert_allclose(interpolated @ start, np.concatenate([x, xc]), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize('gain', [1.1, 3.0])
def test_static_gain_is_the_closed_form(gain: float) -> None:
    # x_{k+1} = (e - k (e - 1)) x with a = 1, e = exp(T): stable while k (e - 1) < e + 1.
    period = max_sampling_period(first_order(1.0), static(-gain))
    assert period == pytest.approx(math.log((gain + 1) / (gain - 1)), rel=2e-3)


def test_stable_plant_left_alone_needs_no_samples() -> None:
    assert max_sampling_period(first_order(-1.0), static(0.0)) == math.inf


def test_a_longer_period_is_unstable_and_a_shorter_one_stable(paper_model: PlantModel) -> None:
    controller = synthesize_rolled_off(paper_model, DesignOptions()).controller
    longest = max_sampling_period(paper_model, controller)

    def radius(period: float) -> float:
        return max(
            float(np.abs(np.linalg.eigvals(matrix)).max())
            for matrix in maps_over(paper_model, controller, period)
        )

    assert radius(1.002 * longest) >= 1
    for period in np.geomspace(1e-5, 0.999 * longest, 50):
        assert radius(period) < 1


def test_default_design_survives_four_milliseconds(paper_model: PlantModel) -> None:
    controller = synthesize_rolled_off(paper_model, DesignOptions()).controller
    assert max_sampling_period(paper_model, controller) > 0.02
