import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_hinf_controller.analysis.hinf_norm import axis_crossings, hinf_norm
from dvs_hinf_controller.state_space import StateSpace


def second_order(frequency: float, damping: float) -> StateSpace:
    return StateSpace(
        a=np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]]),
        b=np.array([[0.0], [1.0]]),
        c=np.array([[frequency**2, 0.0]]),
        d=np.zeros((1, 1)),
    )


@pytest.mark.parametrize('damping', [1e-4, 0.01, 0.3, 0.6])
@pytest.mark.parametrize('frequency', [1e-2, 3.0, 1e4])
def test_resonance_peak_is_the_closed_form(frequency: float, damping: float) -> None:
    norm = hinf_norm(second_order(frequency, damping))
    peak = 1 / (2 * damping * np.sqrt(1 - damping**2))
    assert norm.lower <= peak * (1 + 1e-9)
    assert norm.upper == pytest.approx(peak, rel=1e-6)
    assert norm.frequency == pytest.approx(frequency * np.sqrt(1 - 2 * damping**2), rel=1e-3)


def test_norm_of_a_low_pass_is_its_static_gain() -> None:
    system = StateSpace(
        a=np.array([[-5.0]]), b=np.array([[10.0]]), c=np.array([[1.0]]), d=np.zeros((1, 1))
    )
    assert hinf_norm(system).upper == pytest.approx(2.0, rel=1e-6)


def test_norm_of_an_all_pass_is_its_feedthrough() -> None:
    system = StateSpace(
        a=np.array([[-5.0]]), b=np.array([[1.0]]), c=np.array([[-10.0]]), d=np.ones((1, 1))
    )
    norm = hinf_norm(system)
    assert norm.lower == pytest.approx(1.0, rel=1e-9)
    assert norm.upper == pytest.approx(1.0, rel=1e-6)


def test_unstable_system_has_no_norm() -> None:
    system = StateSpace(
        a=np.array([[0.1]]), b=np.ones((1, 1)), c=np.ones((1, 1)), d=np.zeros((1, 1))
    )
    assert hinf_norm(system).upper == np.inf


def test_the_norm_of_a_zero_system_is_zero() -> None:
    system = StateSpace(a=-np.eye(2), b=np.zeros((2, 1)), c=np.zeros((1, 2)), d=np.zeros((1, 1)))
    assert hinf_norm(system).upper < 1e-100


def test_plateau_that_begins_at_zero_frequency_converges() -> None:
    # A nearly flat gain: one crossing far out, the peak in between.
    system = StateSpace(
        a=np.diag([-1.0, -1.001, -1e4]),
        b=np.array([[1.0], [-1.0], [1e4]]),
        c=np.array([[1.0, 1.0, 1.0]]),
        d=np.zeros((1, 1)),
    )
    norm = hinf_norm(system)
    grid = np.linalg.norm(system.response(np.geomspace(1e-3, 1e6, 4000)), axis=(1, 2))
    assert grid.max() <= norm.upper <= grid.max() * 1.001


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), order=st.integers(1, 7))
def test_bracket_holds_on_a_dense_grid(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((order, order))
    a -= (np.max(np.linalg.eigvals(a).real) + rng.uniform(0.02, 1)) * np.eye(order)
    system = StateSpace(
        a=a,
        b=rng.standard_normal((order, 2)),
        c=rng.standard_normal((3, order)),
        d=0.1 * rng.standard_normal((3, 2)),
    )
    norm = hinf_norm(system)
    grid = np.linalg.norm(system.response(np.geomspace(1e-3, 1e3, 3000)), ord=2, axis=(1, 2))
    assert norm.lower <= norm.upper <= norm.lower * (1 + 2e-7)
    assert grid.max() <= norm.upper
    crossings = axis_crossings(system, 0.5 * norm.lower + 0.5 * np.linalg.norm(system.d, 2))
    assert crossings.size > 0
