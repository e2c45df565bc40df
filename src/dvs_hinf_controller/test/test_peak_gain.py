import math

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from plants import plants

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.peak_gain import impulse_response, peak_gains
from dvs_hinf_controller.state_space import StateSpace, state_response
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import synthesize_rolled_off
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError


def system(a: object, b: object, c: object = None) -> StateSpace:
    a = np.atleast_2d(np.array(a, dtype=float))
    n = len(a)
    return StateSpace(
        a=a,
        b=np.array(b, dtype=float).reshape(n, 1),
        c=np.eye(n) if c is None else np.atleast_2d(np.array(c, dtype=float)),
        d=np.zeros((n if c is None else len(np.atleast_2d(c)), 1)),
    )


@pytest.mark.parametrize('rate', [1e-3, 1.0, 1e5])
def test_first_order_kernel(rate: float) -> None:
    gains = peak_gains(system([[-rate]], [3.0]), np.array([2.0]))
    assert 3 / rate <= gains.state <= 3 / rate * (1 + 3e-4)
    assert 6 / rate <= gains.output <= 6 / rate * (1 + 3e-4)
    assert gains.state_lower <= 3 / rate


@pytest.mark.parametrize('damping', [1e-4, 1e-3, 0.05, 0.3, 1.0])
def test_oscillating_kernel_is_the_closed_form(damping: float) -> None:
    """Integral of |impulse response|: coth for an underdamped, 1 for a critical second order."""
    a = [[0.0, 1.0], [-1.0, -2 * damping]]
    g = system(a, [0.0, 1.0], [[1.0, 0.0]])
    gains = peak_gains(g, np.array([1.0]))
    ratio = math.sqrt(max(1 - damping**2, 0))
    exact = 1 / math.tanh(math.pi * damping / (2 * ratio)) if ratio else 1.0
    assert exact <= gains.state <= exact * (1 + (4e-4 if damping > 1e-3 else 1e-2))
    assert gains.state_lower <= exact


def test_defective_kernel_needs_no_modes() -> None:
    """A Jordan block of size 3: integral t^2 exp(-t) / 2 = 1."""
    a = -np.eye(3) + np.diag([1.0, 1.0], 1)
    gains = peak_gains(system(a, [0.0, 0.0, 1.0], [[1.0, 0.0, 0.0]]), np.array([1.0]))
    assert 1 <= gains.output <= 1 + 4e-4


def test_the_peak_gain_of_a_stiff_kernel_is_the_closed_form() -> None:
    g = system(np.diag([-2.0, -1e6]), [2.0, -1e6], [[1.0, 1.0]])
    # 2 exp(-2 t) - 1e6 exp(-1e6 t) changes sign once, at t0 = log(5e5) / (1e6 - 2).
    t0 = math.log(5e5) / (1e6 - 2)
    exact = 2 * (math.exp(-2 * t0) - math.exp(-1e6 * t0))
    gains = peak_gains(g, np.array([1.0]))
    assert exact <= gains.output <= exact * (1 + 4e-4)


def test_direction_of_a_turning_kernel() -> None:
    """Two orthogonal exponentials: max over v of sum of |v_i| is sqrt(2), not integral ||g||."""
    gains = peak_gains(system(np.diag([-1.0, -20.0]), [1.0, 20.0]), np.array([1.0, 0.0]))
    assert math.sqrt(2) <= gains.state <= math.sqrt(2) * (1 + 4e-4)


def test_direction_in_three_dimensions() -> None:
    gains = peak_gains(
        system(np.diag([-1.0, -20.0, -400.0]), [1.0, 20.0, 400.0]), np.array([0.0, 0.0, 1.0])
    )
    assert math.sqrt(3) <= gains.state <= math.sqrt(3) * (1 + 5e-3)
    assert gains.state_lower == pytest.approx(math.sqrt(3), rel=1e-3)


def test_unstable_and_silent_loops() -> None:
    assert peak_gains(system([[0.1]], [1.0]), np.ones(1)).state == math.inf
    assert peak_gains(system([[-1.0]], [0.0]), np.ones(1)).state == 0
    assert peak_gains(system([[0.0]], [0.0]), np.ones(1)).state == math.inf


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), order=st.integers(1, 6), outputs=st.integers(1, 4))
def test_a_peak_gain_is_never_below_a_fine_integration(
    seed: int, order: int, outputs: int
) -> None:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((order, order))
    a -= (np.max(np.linalg.eigvals(a).real) + rng.uniform(0.1, 1)) * np.eye(order)
    g = system(a, rng.standard_normal(order), rng.standard_normal((outputs, order)))
    c = rng.standard_normal(outputs)
    gains = peak_gains(g, c, rtol=1e-3)
    # A fine, independent trapezoid; its own error is far below the tolerance.
    poles, vectors = np.linalg.eig(a)
    t = np.linspace(0, 12 / -poles.real.max(), 20001)
    modal = np.linalg.solve(vectors, g.b[:, 0])
    values = ((g.c @ vectors * modal) @ np.exp(np.outer(poles, t))).real
    v = rng.standard_normal((outputs, 50))
    v /= np.linalg.norm(v, axis=0)
    step = t[1] * np.abs(v.T @ values)
    assert (step.sum(axis=1) - step[:, 0] / 2).max() <= gains.state * (1 + 1e-5)
    exact = np.trapezoid(np.abs(c @ values), t)
    assert gains.output_lower * (1 - 1e-5) <= exact * (1 + 1e-4)
    slop = 2e-3 * np.linalg.norm(c) * gains.state
    assert exact * (1 - 1e-4) <= gains.output <= exact + slop
    assert gains.state_lower <= gains.state


@settings(max_examples=5, deadline=None)
@given(model=plants(max_states=4, max_inputs=2))
def test_no_disturbance_beats_the_bound(model: PlantModel) -> None:
    """The worst |w| <= 1 for one instant, run through the closed loop, stays below N_T and N_G."""
    try:
        controller = synthesize_rolled_off(model, DesignOptions(gamma_slack=0.05)).controller
    except SynthesisError:
        reject()  # A plant too badly conditioned to have a controller: nothing to measure.
    g = state_response(model, controller)
    gains = peak_gains(g, model.output_vector, rtol=1e-2)
    kernel = impulse_response(g, model.output_vector, rtol=1e-2)
    if kernel is None:
        assert gains.state == math.inf
        return
    output = kernel.values[0, :, -1]
    reached = float(kernel.weights @ (output * np.sign(output)))
    assert reached <= gains.output * (1 + 1e-9)
    assert gains.output <= reached + 0.02 * np.linalg.norm(model.output_vector) * gains.state
