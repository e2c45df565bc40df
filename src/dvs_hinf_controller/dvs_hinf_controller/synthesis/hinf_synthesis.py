"""H-infinity synthesis by two Riccati equations, with a bounded search for the least gamma."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reachability import unreachable_unstable_mode
from dvs_hinf_controller.state_space import GeneralizedPlant, StateSpace, balanced
from dvs_hinf_controller.synthesis.riccati import is_semidefinite, stabilizing_solution
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

_RANK_TOLERANCE = 1e-10
_SEARCH_FLOOR = 1e-8
_SEARCH_CEILING = 1e10
_MAX_BISECTIONS = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class GammaTest:
    """What the Riccati equations say at one gamma.

    Parameters
    ----------
    gamma
        Tested level.
    failure
        The condition that fails, or None where a controller exists.
    spectral_radius
        ``rho(X Y) / gamma^2``; not a number where X or Y is absent.
    """

    gamma: float
    failure: Assumption | None
    spectral_radius: float


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


def hinf_synthesis(
    plant: GeneralizedPlant, *, slack: float = 1e-3, rtol: float = 1e-6
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

    Raises
    ------
    SynthesisError
        If an assumption fails; it is named. Never a controller that does not stabilize: the closed
        loop's eigenvalues are checked.
    """
    require_assumptions(plant)
    tests: list[GammaTest] = []
    optimal = _least_gamma(plant, rtol, tests)
    return _synthesis_at(plant, optimal * (1 + slack), optimal, tests)


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
    return _synthesis_at(plant, gamma, gamma, [])


def _synthesis_at(
    plant: GeneralizedPlant, gamma: float, optimal: float, tests: list[GammaTest]
) -> HinfSynthesis:
    solution = _solve(plant, gamma)
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
    return _solve(plant, gamma).test


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
        if not _full_column_rank(matrix):
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


def _least_gamma(plant: GeneralizedPlant, rtol: float, tests: list[GammaTest]) -> float:
    def feasible(gamma: float) -> bool:
        tests.append(_solve(plant, gamma).test)
        return tests[-1].failure is None

    low, high = _SEARCH_FLOOR, 1.0
    while not feasible(high):
        low, high = high, 10 * high
        if high > _SEARCH_CEILING:
            raise _failure(tests[-1])
    while low == _SEARCH_FLOOR and high > _SEARCH_FLOOR:
        if not feasible(high / 10):
            low = high / 10
        else:
            high /= 10
    for _ in range(_MAX_BISECTIONS):
        if high <= low * (1 + rtol):
            break
        middle = math.sqrt(low * high)
        low, high = (low, middle) if feasible(middle) else (middle, high)
    return high


def _solve(plant: GeneralizedPlant, gamma: float) -> _Solution:
    x = _riccati(plant.a, plant.b1, plant.b2, plant.c1, plant.d12, gamma)
    if x is None:
        return _failed(gamma, Assumption.X_ABSENT)
    if not is_semidefinite(x):
        return _failed(gamma, Assumption.X_INDEFINITE)
    y = _riccati(plant.a.T, plant.c1.T, plant.c2.T, plant.b1.T, plant.d21.T, gamma)
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


def _riccati(
    a: FloatArray, b1: FloatArray, b2: FloatArray, c1: FloatArray, d12: FloatArray, gamma: float
) -> FloatArray | None:
    weight = np.linalg.inv(d12.T @ d12)
    drift = a - b2 @ weight @ d12.T @ c1
    projected = c1 - d12 @ weight @ d12.T @ c1
    return stabilizing_solution(
        drift, b2 @ weight @ b2.T - b1 @ b1.T / gamma**2, projected.T @ projected
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


def _full_column_rank(matrix: FloatArray) -> bool:
    if matrix.shape[0] < matrix.shape[1]:
        return False
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values.size == 0 or values[-1] > _RANK_TOLERANCE * max(float(values[0]), 1e-300))


def _axis_zero(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float | None:
    """Zero on the axis of a plant whose `d` has full column rank (ZDG 1996, lemma 13.9)."""
    weight = np.linalg.inv(d.T @ d)
    drift = a - b @ weight @ d.T @ c
    projected = c - d @ weight @ d.T @ c
    for mode in np.linalg.eigvals(drift):
        if abs(mode.real) > 1e-9 * max(1.0, float(np.linalg.norm(drift))):
            continue
        pencil = np.vstack([drift - mode * np.eye(len(a)), projected])
        if np.linalg.svd(pencil, compute_uv=False)[-1] <= _RANK_TOLERANCE * max(
            1.0, float(np.linalg.norm(drift))
        ):
            return float(abs(mode.imag))
    return None
