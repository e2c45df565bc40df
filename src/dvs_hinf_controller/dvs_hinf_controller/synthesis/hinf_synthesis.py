"""H-infinity synthesis by two Riccati equations, with a bounded search for the least gamma."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reachability import has_full_column_rank, unreachable_unstable_mode
from dvs_hinf_controller.state_space import GeneralizedPlant, StateSpace, balanced
from dvs_hinf_controller.synthesis.gamma_search import GammaSearch, GammaTest
from dvs_hinf_controller.synthesis.riccati import is_semidefinite, stabilizing_solution
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError


@dataclass(frozen=True, slots=True, kw_only=True)
class HinfSynthesis:
    """A controller with its proof.

    Parameters
    ----------
    controller
        K from y to u, balanced, strictly proper.
    gamma_optimal
        Least gamma of the bisection, an upper bound of the infimum.
    gamma
        Level at which `controller` was computed: ``gamma_optimal (1 + slack)``.
    tests
        Every gamma that was tried, in order.
    """

    controller: StateSpace
    gamma_optimal: float
    gamma: float
    tests: tuple[GammaTest, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Solution:
    test: GammaTest
    x: FloatArray | None = None
    y: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Equation:
    """A Riccati equation but for gamma."""

    drift: FloatArray
    control: FloatArray
    disturbance: FloatArray
    cost: FloatArray

    def solution(self, gamma: float) -> FloatArray | None:
        quadratic = self.control - self.disturbance / gamma**2
        return stabilizing_solution(self.drift, quadratic, self.cost)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Equations:
    """Those for X and Y."""

    control: _Equation
    filter: _Equation

    @classmethod
    def of(cls, plant: GeneralizedPlant) -> _Equations:
        return cls(
            control=_equation(plant.a, plant.b1, plant.b2, plant.c1, plant.d12),
            filter=_equation(plant.a.T, plant.c1.T, plant.c2.T, plant.b1.T, plant.d21.T),
        )


def hinf_synthesis(
    plant: GeneralizedPlant,
    *,
    slack: float = 1e-3,
    rtol: float = 1e-6,
    near: float | None = None,
) -> HinfSynthesis:
    """Central controller with ``||F_l(P, K)||_inf < gamma`` near the least gamma.

    Doyle, Glover, Khargonekar and Francis 1989, theorem 3, with the cross terms of Zhou, Doyle and
    Glover 1996, section 16.4.

    Parameters
    ----------
    plant
        P, with D11 = 0 and D22 = 0.
    slack
        Relative distance from the least gamma at which K is computed, > 0: K becomes needlessly
        stiff as it goes to zero.
    rtol
        Relative accuracy of the bisection on gamma.
    near
        Where the least gamma is expected; saves time where that is so. None for no idea.

    Raises
    ------
    SynthesisError
        If an assumption fails; it is named. Never a controller that does not stabilize: the closed
        loop's eigenvalues are checked.
    """
    require_assumptions(plant)
    equations = _Equations.of(plant)
    search = GammaSearch(lambda gamma: _solve(equations, gamma).test, rtol=rtol)
    optimal = search.least(near)
    if optimal is None:
        raise _failure(search.tests[-1])
    return _synthesis_at(plant, equations, optimal * (1 + slack), optimal, search.tests)


def hinf_synthesis_at(plant: GeneralizedPlant, gamma: float) -> HinfSynthesis:
    """Central controller with ``||F_l(P, K)||_inf < gamma``, without a search.

    Parameters
    ----------
    plant
        P, with D11 = 0 and D22 = 0.
    gamma
        Level.

    Raises
    ------
    SynthesisError
        If an assumption fails, or no controller reaches the level.
    """
    require_assumptions(plant)
    return _synthesis_at(plant, _Equations.of(plant), gamma, gamma, [])


def _synthesis_at(
    plant: GeneralizedPlant,
    equations: _Equations,
    gamma: float,
    optimal: float,
    tests: list[GammaTest],
) -> HinfSynthesis:
    solution = _solve(equations, gamma)
    tests.append(solution.test)
    if solution.x is None or solution.y is None:
        raise _failure(solution.test)
    controller = balanced(_central_controller(plant, gamma, solution.x, solution.y))
    _confirm_stable(plant, controller)
    return HinfSynthesis(
        controller=controller, gamma_optimal=optimal, gamma=gamma, tests=tuple(tests)
    )


def gamma_test(plant: GeneralizedPlant, gamma: float) -> GammaTest:
    """Whether a controller with ``||F_l(P, K)||_inf < gamma`` exists, by the Riccati conditions.

    Parameters
    ----------
    plant
        P; it must meet `require_assumptions`.
    gamma
        Level.
    """
    return _solve(_Equations.of(plant), gamma).test


def require_assumptions(plant: GeneralizedPlant) -> None:
    """Raise `SynthesisError` for the first of the assumptions (A1) to (A4) that fails.

    Zhou, Doyle and Glover 1996, section 16.4.1.

    Parameters
    ----------
    plant
        P.
    """
    a = plant.a
    if (mode := unreachable_unstable_mode(a, plant.b2)) is not None:
        raise SynthesisError(
            Assumption.STABILIZABILITY, f'u does not reach the unstable mode s = {mode:.6g}'
        )
    if (mode := unreachable_unstable_mode(a.T, plant.c2.T)) is not None:
        raise SynthesisError(
            Assumption.DETECTABILITY, f'y does not show the unstable mode s = {mode:.6g}'
        )
    for name, matrix in (('D12', plant.d12), ('D21 transposed', plant.d21.T)):
        if not has_full_column_rank(matrix):
            raise SynthesisError(
                Assumption.RANK,
                f'{name} has no full column rank; add a cost on u and noise on y to regularise',
            )
    for name, zero in (
        ('from u to z', _axis_zero(a, plant.b2, plant.c1, plant.d12)),
        ('from w to y', _axis_zero(a.T, plant.c2.T, plant.b1.T, plant.d21.T)),
    ):
        if zero is not None:
            raise SynthesisError(
                Assumption.AXIS_ZERO,
                f'the plant {name} has a zero at s = {zero:.4g}j on the imaginary axis',
            )


def _solve(equations: _Equations, gamma: float) -> _Solution:
    x = equations.control.solution(gamma)
    if x is None:
        return _failed(gamma, Assumption.X_ABSENT)
    if not is_semidefinite(x):
        return _failed(gamma, Assumption.X_INDEFINITE)
    y = equations.filter.solution(gamma)
    if y is None:
        return _failed(gamma, Assumption.Y_ABSENT)
    if not is_semidefinite(y):
        return _failed(gamma, Assumption.Y_INDEFINITE)
    radius = float(np.max(np.abs(np.linalg.eigvals(x @ y)), initial=0.0)) / gamma**2
    if radius >= 1:
        return _failed(gamma, Assumption.SPECTRAL_RADIUS, radius)
    test = GammaTest(gamma=gamma, failure=None, spectral_radius=radius)
    return _Solution(test=test, x=x, y=y)


def _failed(gamma: float, failure: Assumption, radius: float = math.nan) -> _Solution:
    return _Solution(test=GammaTest(gamma=gamma, failure=failure, spectral_radius=radius))


def _equation(
    a: FloatArray, b1: FloatArray, b2: FloatArray, c1: FloatArray, d12: FloatArray
) -> _Equation:
    weight = np.linalg.inv(d12.T @ d12)
    projected = c1 - d12 @ weight @ d12.T @ c1
    return _Equation(
        drift=a - b2 @ weight @ d12.T @ c1,
        control=b2 @ weight @ b2.T,
        disturbance=b1 @ b1.T,
        cost=projected.T @ projected,
    )


def _central_controller(
    plant: GeneralizedPlant, gamma: float, x: FloatArray, y: FloatArray
) -> StateSpace:
    cost = plant.d12.T @ plant.d12
    feedback = np.asarray(
        np.linalg.solve(cost, -plant.b2.T @ x - plant.d12.T @ plant.c1), dtype=np.float64
    )
    injection = np.linalg.solve(
        plant.d21 @ plant.d21.T, (y @ plant.c2.T + plant.b1 @ plant.d21.T).T
    ).T
    worst = plant.b1.T @ x / gamma**2
    gain = np.linalg.solve(np.eye(x.shape[0]) - y @ x / gamma**2, injection)
    return StateSpace(
        a=plant.a + plant.b1 @ worst + plant.b2 @ feedback - gain @ (plant.c2 + plant.d21 @ worst),
        b=gain,
        c=feedback,
        d=np.zeros((plant.b2.shape[1], plant.c2.shape[0])),
    )


def _confirm_stable(plant: GeneralizedPlant, controller: StateSpace) -> None:
    abscissa = float(np.max(plant.close(controller).poles().real))
    if not abscissa < 0:
        raise SynthesisError(
            Assumption.CONFIRMATION,
            f'the closed loop has a pole with real part {abscissa:.3g}: the problem is too badly '
            'scaled for double precision; increase the regularisation or gamma_slack',
        )


def _failure(test: GammaTest) -> SynthesisError:
    assert test.failure is not None
    texts = {
        Assumption.X_ABSENT: 'the control Riccati equation has no stabilizing solution',
        Assumption.X_INDEFINITE: 'the control Riccati solution X is indefinite',
        Assumption.Y_ABSENT: 'the filter Riccati equation has no stabilizing solution',
        Assumption.Y_INDEFINITE: 'the filter Riccati solution Y is indefinite',
        Assumption.SPECTRAL_RADIUS: f'rho(X Y) = {test.spectral_radius:.4g} gamma^2, must be less',
    }
    return SynthesisError(test.failure, f'{texts[test.failure]} at gamma = {test.gamma:.6g}')


def _axis_zero(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float | None:
    """Zero on the axis of a plant whose `d` has full column rank (ZDG 1996, lemma 13.9)."""
    weight = np.linalg.inv(d.T @ d)
    drift = a - b @ weight @ d.T @ c
    projected = c - d @ weight @ d.T @ c
    scale = max(1.0, float(np.linalg.norm(drift)))
    for mode in np.linalg.eigvals(drift):
        if abs(mode.real) > 1e-9 * scale:
            continue
        pencil = np.vstack([drift - mode * np.eye(len(a)), projected])
        if not has_full_column_rank(pencil, scale=scale):
            return float(abs(mode.imag))
    return None
