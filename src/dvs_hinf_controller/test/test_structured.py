import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from plants import nevanlinna_pick_optimum, plants

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.hinf_norm import hinf_norm
from dvs_hinf_controller.analysis.mu import mu_bounds, mu_response
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import StateSpace, state_response
from dvs_hinf_controller.synthesis.full_plant import full_plant
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import synthesize_rolled_off
from dvs_hinf_controller.synthesis.structured import synthesize_structured
from dvs_hinf_controller.synthesis.weight_fit import fit_magnitude

TIGHT = DesignOptions(gamma_slack=1e-3)


def gain_and_mu(model: PlantModel, controller: LinearController) -> tuple[float, float]:
    g = state_response(model, controller)
    return hinf_norm(g).upper, mu_bounds(g, model.output_vector).upper


def test_nevanlinna_pick_gives_the_theorys_numbers(paper_model: PlantModel) -> None:
    unstructured = nevanlinna_pick_optimum(paper_model, structured=False)
    assert math.sqrt(2) * unstructured == pytest.approx(1.9567, abs=1e-4)
    assert nevanlinna_pick_optimum(paper_model, structured=True) == pytest.approx(2.3860, abs=1e-4)


# Unstable and non-minimum-phase plants with real poles and zeros.
INTERPOLATED = {
    'paper': ([[2.0, 10.0], [0.0, 5.0]], [1.0, 1.0], [2.0, 1.0]),
    'two unstable poles': ([[1.0, 0.0], [0.0, 3.0]], [1.0, 1.0], [1.0, 1.0]),
    'non-minimum-phase': ([[1.0, 0.0], [0.0, -2.0]], [1.0, 1.0], [1.0, -0.7]),
    'relative degree two': ([[0.0, 1.0], [2.0, -1.0]], [0.0, 1.0], [1.0, 0.0]),
    'two poles and a zero': (
        [[1.0, 0.0, 0.0], [0.0, 2.5, 0.0], [0.0, 0.0, -1.0]],
        [1.0, 1.0, 1.0],
        [-2.0, 1.0, 0.5],
    ),
}


@pytest.mark.parametrize('name', INTERPOLATED)
def test_one_input_reaches_the_interpolation_optimum(name: str) -> None:
    a, b, c = INTERPOLATED[name]
    model = PlantModel(
        state_matrix=np.array(a), input_matrix=np.array(b)[:, None], output_vector=np.array(c)
    )
    gain, _ = gain_and_mu(model, synthesize_rolled_off(model, TIGHT).controller)
    _, mu = gain_and_mu(model, synthesize_structured(model, TIGHT))
    best_gain = nevanlinna_pick_optimum(model, structured=False)
    best_mu = nevanlinna_pick_optimum(model, structured=True)
    assert best_gain * (1 - 1e-4) <= gain <= best_gain * 1.0015
    assert best_mu * (1 - 1e-4) <= mu <= best_mu * 1.003


@pytest.mark.parametrize('c', [0.5, 2.0])
def test_first_order_plant_is_the_closed_form(c: float) -> None:
    # T(a) = -1 and the maximum principle: |T| >= 1, ||G|| = |T| / c.
    model = PlantModel(
        state_matrix=np.array([[1.5]]),
        input_matrix=np.array([[2.0]]),
        output_vector=np.array([c]),
    )
    gain, mu = gain_and_mu(model, synthesize_structured(model, TIGHT))
    assert 1 / c <= gain <= 1.0015 / c
    assert 1 + 1 / c <= mu <= 1.002 * (1 + 1 / c)


def test_mu_bound_holds_between_grid_points() -> None:
    """A resonance a thousand times narrower than the grid that the bound starts from."""
    damping, frequency = 1e-6, 7.123456789
    g = StateSpace(
        a=np.array([[0.0, frequency], [-frequency, -2 * damping * frequency]]),
        b=np.array([[0.0], [1.0]]),
        c=np.array([[1e-3, 0.0], [0.0, 1e-3]]),
        d=np.zeros((2, 1)),
    )
    c = np.array([0.6, 0.8])
    bounds = mu_bounds(g, c)
    near = frequency * (1 + np.linspace(-20, 20, 4001) * damping)
    peak = mu_response(g, c, near).max()
    assert peak <= bounds.upper <= peak * 1.002
    assert bounds.lower >= peak * 0.998


def test_mu_of_an_unstable_or_silent_loop() -> None:
    g = StateSpace(a=np.eye(1), b=np.ones((1, 1)), c=np.ones((1, 1)), d=np.zeros((1, 1)))
    assert mu_bounds(g, np.ones(1)).upper == math.inf
    g = StateSpace(a=-np.eye(1), b=np.zeros((1, 1)), c=np.ones((1, 1)), d=np.zeros((1, 1)))
    assert mu_bounds(g, np.ones(1)).upper == 0


@pytest.mark.parametrize('r', [1, 3])
def test_worst_case_makes_the_papers_full_loop_singular(paper_model: PlantModel, r: int) -> None:
    """The witness, spread over r pixels, in the paper's own plant: det(I - M Delta) = 0."""
    controller = synthesize_structured(paper_model, DesignOptions())
    bounds = mu_bounds(state_response(paper_model, controller), paper_model.output_vector)
    worst = bounds.worst_case
    assert worst is not None
    n = paper_model.state_count
    mean = StateSpace(
        a=controller.state_matrix,
        b=controller.input_vector[:, None] * np.full((1, r), 1 / r),
        c=controller.output_matrix,
        d=controller.feedthrough[:, None] * np.full((1, r), 1 / r),
    )
    m = full_plant(paper_model, r).close(mean).response(np.array([worst.frequency]))[0]
    sector = np.kron(np.eye(r), worst.sector * np.eye(n))
    # Every w2_i answers to the mean of the copies of x.
    performance = np.ones((r, 1)) @ np.kron(np.full((1, r), 1 / r), worst.performance[None, :])
    delta = np.block(
        [
            [sector, np.zeros((n * r, n * r))],
            [np.zeros((r, n * r)), performance],
        ]
    )
    loop = np.eye(len(m)) - m @ delta
    assert np.linalg.svd(loop, compute_uv=False)[-1] < 1e-9
    assert max(abs(worst.sector), np.linalg.norm(performance, 2)) == pytest.approx(worst.size)
    assert bounds.lower == pytest.approx(1 / worst.size)
    assert bounds.lower <= bounds.upper <= 1.001 * bounds.lower


@pytest.mark.parametrize('r', [1, 3])
def test_ab13md_agrees_on_r_pixels(paper_model: PlantModel, r: int) -> None:
    """SLICOT's mu upper bound of the r-pixel loop, which knows nothing of the reduction.

    Only c'w1_i enters, so that the sectors are r scalar blocks; the mean controller couples them.
    """
    slycot = pytest.importorskip('slycot')
    controller = synthesize_structured(paper_model, DesignOptions())
    g = state_response(paper_model, controller)
    n = paper_model.state_count
    w = np.array([0.1, 1.0, 10.0, 60.0])
    ours = mu_response(g, paper_model.output_vector, w)
    for value, response in zip(ours, g.response(w)[:, :, 0], strict=True):
        t = complex(paper_model.output_vector @ response)
        m = np.zeros((r + n, r + n), dtype=complex)
        m[:r, :r], m[:r, r] = t / r, t
        m[r:, :r], m[r:, r] = response[:, None] / r, response
        bound, *_ = slycot.ab13md(m, np.array([1] * r + [n]), np.full(r + 1, 2))
        assert bound == pytest.approx(value, rel=2e-3)


def test_another_input_does_not_raise_mu(paper_model: PlantModel) -> None:
    wide = PlantModel(
        state_matrix=paper_model.state_matrix,
        input_matrix=np.hstack([paper_model.input_matrix, [[0.0], [1.0]]]),
        output_vector=paper_model.output_vector,
    )
    _, mu = gain_and_mu(wide, synthesize_structured(wide, DesignOptions()))
    _, start = gain_and_mu(wide, synthesize_rolled_off(wide, DesignOptions()).controller)
    assert mu <= start
    assert mu <= 2.3860


@pytest.mark.ensemble
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(model=plants(max_states=5, max_inputs=2))
def test_designs_of_random_plants_meet_their_norms(model: PlantModel) -> None:
    options = DesignOptions(gamma_slack=1e-2)
    unstructured = synthesize_rolled_off(model, options)
    structured = synthesize_structured(model, options)
    g = state_response(model, unstructured.controller)
    assert g.poles().real.max() < 0
    norm = hinf_norm(g)
    assert norm.upper <= unstructured.gamma * (1 + 1e-6)
    for controller in (unstructured.controller, structured):
        g = state_response(model, controller)
        assert g.poles().real.max() < 0
        bounds = mu_bounds(g, model.output_vector)
        grid = mu_response(g, model.output_vector, np.geomspace(1e-3, 1e5, 500))
        assert bounds.lower <= bounds.upper
        assert grid.max() <= bounds.upper * (1 + 1e-9)
    _, start = gain_and_mu(model, unstructured.controller)
    _, mu = gain_and_mu(model, structured)
    assert mu <= start * 1.012


def test_weight_fit_is_stable_minimum_phase_and_close() -> None:
    w = np.geomspace(1e-3, 1e3, 150)
    s = 1j * w
    wanted = np.abs((s + 3) * (s * s + 0.2 * s + 4) / ((s + 0.3) * (s * s + 0.6 * s + 9)))
    fit = fit_magnitude(w, wanted)
    v = fit.weight
    assert fit.error < 0.01
    np.testing.assert_allclose(np.abs(v.response(w)[:, 0, 0]), wanted, rtol=0.011)
    assert np.linalg.eigvals(v.a).real.max() < 0
    assert np.linalg.eigvals(v.a - v.b @ v.c / v.d).real.max() < 0


def test_constant_weight_has_no_states() -> None:
    fit = fit_magnitude(np.geomspace(1, 10, 20), np.full(20, 2.5))
    assert fit.weight.order == 0
    assert fit.weight.d[0, 0] == pytest.approx(2.5)
