import dataclasses
import math

import numpy as np
import pytest

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.hinf_norm import hinf_norm
from dvs_hinf_controller.state_space import GeneralizedPlant, StateSpace
from dvs_hinf_controller.synthesis.full_plant import full_plant
from dvs_hinf_controller.synthesis.hinf_synthesis import (
    balanced,
    gamma_test,
    hinf_synthesis,
    require_assumptions,
)
from dvs_hinf_controller.synthesis.one_pixel_plant import reduced_plant
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError


def plant(a: object, **changes: object) -> GeneralizedPlant:
    """Every assumption holds; x and u are performance, noise on x and y the disturbance."""
    a = np.atleast_2d(np.array(a, dtype=float))
    n = len(a)
    ones, zeros = np.ones((n, 1)), np.zeros((n, 1))
    base = GeneralizedPlant(
        a=a,
        b1=np.hstack([np.eye(n), zeros]),
        b2=ones,
        c1=np.vstack([np.eye(n), zeros.T]),
        c2=ones.T,
        d12=np.vstack([zeros, [[1.0]]]),
        d21=np.hstack([zeros.T, [[1.0]]]),
    )
    return dataclasses.replace(base, **changes)


def failure_of(p: GeneralizedPlant) -> SynthesisError:
    with pytest.raises(SynthesisError) as caught:
        hinf_synthesis(p)
    return caught.value


def test_stabilizability_is_named() -> None:
    error = failure_of(plant(np.diag([1.0, -1.0]), b2=np.array([[0.0], [1.0]])))
    assert error.assumption is Assumption.STABILIZABILITY
    assert 'stabilizability: u does not reach the unstable mode s = 1' in str(error)


def test_detectability_is_named() -> None:
    error = failure_of(plant(np.diag([2.0, -1.0]), c2=np.array([[0.0, 1.0]])))
    assert error.assumption is Assumption.DETECTABILITY
    assert 'detectability: y does not show the unstable mode s = 2' in str(error)


def test_rank_is_named_for_u() -> None:
    error = failure_of(plant(1.0, d12=np.zeros((2, 1))))
    assert error.assumption is Assumption.RANK
    assert 'rank: D12 has no full column rank; add a cost on u' in str(error)


def test_rank_is_named_for_y() -> None:
    error = failure_of(plant(1.0, d21=np.zeros((1, 2))))
    assert error.assumption is Assumption.RANK
    assert 'D21 transposed has no full column rank' in str(error)


def test_axis_zero_is_named() -> None:
    # From u to z: x is not weighted at all, the integrator is a zero at the origin.
    error = failure_of(plant(0.0, c1=np.zeros((2, 1))))
    assert error.assumption is Assumption.AXIS_ZERO
    assert 'jw-axis zero: the plant from u to z has a zero at s = 0j' in str(error)
    error = failure_of(plant(0.0, b1=np.zeros((1, 2))))
    assert 'the plant from w to y has a zero at s = 0j' in str(error)


def test_oscillating_axis_zero_is_named_with_its_frequency() -> None:
    a = np.array([[0.0, 3.0], [-3.0, 0.0]])
    error = failure_of(plant(a, c1=np.zeros((3, 2))))
    assert error.assumption is Assumption.AXIS_ZERO
    assert 's = 3j' in str(error)


# x' = a x + w1 + u, z = (x, u), y = x + w2: everything in closed form. X solves
# 2 a X - X^2 (1 - 1/gamma^2) + 1 = 0; Y the same; rho(XY) < gamma^2.
def scalar_riccati(a: float, gamma: float) -> float:
    s = 1 - 1 / gamma**2
    return (a + math.sqrt(a * a + s)) / s


@pytest.mark.parametrize('a', [-1.0, 0.0, 0.5, 2.0])
def test_gamma_of_the_scalar_problem_is_the_closed_form(a: float) -> None:
    # rho(XY) = gamma^2 means X = gamma, hence gamma^2 - 2 a gamma - 2 = 0.
    result = hinf_synthesis(plant(a), rtol=1e-9)
    assert result.gamma_optimal == pytest.approx(a + math.sqrt(a * a + 2), rel=1e-7)


def test_tests_name_every_riccati_failure() -> None:
    p = plant(1.0)
    assert gamma_test(p, 100.0).failure is None
    assert gamma_test(p, 2.0).failure is Assumption.SPECTRAL_RADIUS
    assert gamma_test(p, 2.0).spectral_radius == pytest.approx(
        (scalar_riccati(1.0, 2.0) / 2.0) ** 2
    )
    # Below 1 the quadratic term turns over: 2 a X + |s| X^2 + 1 = 0 has no stabilizing root > 0.
    assert gamma_test(p, 0.9).failure is Assumption.X_INDEFINITE
    assert gamma_test(plant(0.1), 0.3).failure is Assumption.X_ABSENT
    # The same for Y alone: X is easy where u is cheap and w1 reaches x weakly.
    filter_bound = plant(1.0, c1=np.array([[1.0], [0.0]]), b1=np.array([[0.1, 0.0]]))
    assert gamma_test(filter_bound, 0.9).failure is Assumption.Y_INDEFINITE
    assert (
        gamma_test(dataclasses.replace(filter_bound, a=np.array([[0.03]])), 0.9).failure
        is Assumption.Y_ABSENT
    )


@pytest.mark.parametrize(
    'assumption',
    [
        Assumption.X_ABSENT,
        Assumption.X_INDEFINITE,
        Assumption.Y_ABSENT,
        Assumption.Y_INDEFINITE,
        Assumption.SPECTRAL_RADIUS,
    ],
)
def test_search_without_success_names_the_last_failure(
    monkeypatch: pytest.MonkeyPatch, assumption: Assumption
) -> None:
    from dvs_hinf_controller.synthesis import hinf_synthesis as module

    def fail(_: GeneralizedPlant, gamma: float) -> object:
        test = module.GammaTest(gamma=gamma, failure=assumption, spectral_radius=2.5)
        return module._Solution(test=test)

    monkeypatch.setattr(module, '_solve', fail)
    error = failure_of(plant(1.0))
    assert error.assumption is assumption
    assert f'no controller: {assumption.value}: ' in str(error)
    assert 'at gamma = 1e+10' in str(error)
    if assumption is Assumption.SPECTRAL_RADIUS:
        assert 'rho(X Y) = 2.5 gamma^2' in str(error)


def test_unstable_result_is_never_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    from dvs_hinf_controller.synthesis import hinf_synthesis as module

    def garbage(*_: object) -> StateSpace:
        return StateSpace(a=-np.eye(1), b=np.ones((1, 1)), c=np.zeros((1, 1)), d=np.zeros((1, 1)))

    monkeypatch.setattr(module, '_central_controller', garbage)
    error = failure_of(plant(1.0))
    assert error.assumption is Assumption.CONFIRMATION
    assert 'the closed loop has a pole with real part 1' in str(error)


def test_norm_confirms_gamma_with_cross_terms() -> None:
    rng = np.random.default_rng(3)
    p = GeneralizedPlant(
        a=rng.standard_normal((4, 4)) + np.eye(4),
        b1=rng.standard_normal((4, 3)),
        b2=rng.standard_normal((4, 2)),
        c1=rng.standard_normal((5, 4)),
        c2=rng.standard_normal((2, 4)),
        d12=rng.standard_normal((5, 2)),
        d21=rng.standard_normal((2, 3)),
    )
    result = hinf_synthesis(p, slack=1e-2)
    norm = hinf_norm(p.close(result.controller))
    assert norm.upper < result.gamma
    assert norm.upper > 0.97 * result.gamma_optimal
    assert any(test.failure is not None for test in result.tests)
    assert result.tests[-1].failure is None


def test_balancing_keeps_the_controller() -> None:
    rng = np.random.default_rng(0)
    scale = np.diag([1.0, 1e6, 1e-4])
    system = StateSpace(
        a=np.linalg.inv(scale) @ (rng.standard_normal((3, 3)) - 3 * np.eye(3)) @ scale,
        b=np.linalg.inv(scale) @ rng.standard_normal((3, 1)),
        c=rng.standard_normal((2, 3)) @ scale,
        d=np.zeros((2, 1)),
    )
    result = balanced(system)
    w = np.geomspace(1e-2, 1e2, 20)
    np.testing.assert_allclose(result.response(w), system.response(w), rtol=1e-9)
    assert np.abs(result.a).max() < 1e-3 * np.abs(system.a).max()


@pytest.mark.parametrize('r', [1, 3])
def test_reduced_problem_has_the_full_problems_optimum(paper_model: PlantModel, r: int) -> None:
    """Paper, eq. 23 without its second row, for r pixels: the same regularisation, the same gamma.

    r copies of x and a mean over r pixels: the cost on u scales by sqrt(r), w by 1/sqrt(r).
    """
    cost, noise = 1e-2, 1e-2
    full = full_plant(
        paper_model,
        r,
        performance_copies=1,
        input_cost=cost * math.sqrt(r),
        process_noise=noise / math.sqrt(r) * math.sqrt(2),
    )
    reduced = reduced_plant(paper_model, input_cost=cost, process_noise=noise)
    gamma_full = hinf_synthesis(full, rtol=1e-8).gamma_optimal
    gamma_reduced = hinf_synthesis(reduced, rtol=1e-8).gamma_optimal
    assert gamma_full == pytest.approx(math.sqrt(2) * gamma_reduced, rel=1e-5)


@pytest.mark.parametrize('r', [1, 3])
def test_hinfsyn_agrees_on_the_full_problem(paper_model: PlantModel, r: int) -> None:
    pytest.importorskip('slycot')
    control = pytest.importorskip('control')
    p = full_plant(paper_model, r, performance_copies=1, input_cost=1e-2, process_noise=1e-2)
    b, c = np.hstack([p.b1, p.b2]), np.vstack([p.c1, p.c2])
    d = np.block(
        [
            [np.zeros((p.c1.shape[0], p.b1.shape[1])), p.d12],
            [p.d21, np.zeros((p.c2.shape[0], p.b2.shape[1]))],
        ]
    )
    _, _, gamma, _ = control.hinfsyn(control.ss(p.a, b, c, d), r, 1)
    assert hinf_synthesis(p).gamma_optimal == pytest.approx(gamma, rel=2e-3)


def test_require_assumptions_accepts_the_regularised_example(paper_model: PlantModel) -> None:
    require_assumptions(reduced_plant(paper_model, input_cost=1e-2, process_noise=1e-2))
    with pytest.raises(SynthesisError, match='rank'):
        require_assumptions(full_plant(paper_model, 1))
