"""Least sum of an L1 norm and the largest of several: a primal-dual interior-point method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError

_MOST_STEPS = 80
_GAP = 1e-5
# A gap that is good enough where rounding stops the method.
_FAIR_GAP = 1e-2
# One at which the method ends where a step hardly helps.
_SMALL_GAP, _STALLED = 1e-3, 0.7
_TO_THE_EDGE = 0.99
_LEAST_STEP = 1e-6
_RIDGE = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True)
class L1Problem:
    """Minimise ``sum w |r_0| + max_j sum w |r_j|``, ``r_j = slopes_j theta + offsets_j``.

    Parameters
    ----------
    slopes
        Shape (1 + D, N, k), D >= 1.
    offsets
        Shape (1 + D, N).
    weights
        w > 0, shape (N,).
    equal_slope
        ``equal_slope theta + equal_offset = 0``, shape (e, k).
    equal_offset
        Shape (e,).
    """

    slopes: FloatArray
    offsets: FloatArray
    weights: FloatArray
    equal_slope: FloatArray
    equal_offset: FloatArray


def least_l1(problem: L1Problem) -> FloatArray:
    """Coefficients theta whose objective exceeds the optimum by a share of 1e-5 at most.

    Residuals are split into ``p - q`` with p, q >= 0; with ``y`` between -lambda w and lambda w
    for the dual, every step is a Newton step towards a centre (Mehrotra 1992), whose equations
    have one row a coefficient and a direction, whatever N.

    Parameters
    ----------
    problem
        What is minimised.

    Returns
    -------
    FloatArray
        theta, shape (k,).

    Raises
    ------
    SynthesisError
        If rounding stops the method where the duality gap exceeds a hundredth.
    """
    point = _Point.start(problem)
    for _ in range(_MOST_STEPS):
        if point.gap <= _GAP * point.objective(problem):
            break
        moved = _improved(problem, point)
        if moved is None:
            break
        fair = point.gap <= _SMALL_GAP * point.objective(problem)
        if fair and moved.gap > _STALLED * point.gap:
            break
        point = moved
    if not point.gap <= _FAIR_GAP * point.objective(problem):
        detail = f'the L1 program ended with a duality gap of {point.gap:.3g}'
        raise SynthesisError(Assumption.CONFIRMATION, detail)
    return point.theta


@dataclass(frozen=True, slots=True, kw_only=True)
class _Point:
    """Primal (theta, p, q, s, slack) and dual (y, lambda); or a step of them."""

    theta: FloatArray
    above: FloatArray
    below: FloatArray
    top: float
    slack: FloatArray
    y: FloatArray
    multiplier: FloatArray
    zp: FloatArray
    zq: FloatArray

    @classmethod
    def start(cls, problem: L1Problem) -> _Point:
        """Feasible in the primal and in the dual."""
        theta = np.asarray(np.linalg.lstsq(problem.equal_slope, -problem.equal_offset)[0], float)
        residual = problem.slopes @ theta + problem.offsets
        sizes = np.abs(residual) @ problem.weights
        room = max(float(sizes.max()), 1e-300) / problem.weights / problem.weights.size
        above, below = np.maximum(residual, 0) + room, np.maximum(-residual, 0) + room
        totals = (above[1:] + below[1:]) @ problem.weights
        top = 2 * float(totals.max())
        count = len(totals)
        multiplier = np.full(count, 1 / count)
        most = np.concatenate([[1.0], multiplier])[:, None] * problem.weights
        return cls(
            theta=theta,
            above=above,
            below=below,
            top=top,
            slack=top - totals,
            y=np.zeros_like(residual),
            multiplier=multiplier,
            zp=most,
            zq=most.copy(),
        )

    @property
    def gap(self) -> float:
        """Difference of the objectives of primal and dual."""
        products = np.vdot(self.above, self.zp) + np.vdot(self.below, self.zq)
        return float(products + self.slack @ self.multiplier)

    @property
    def centre(self) -> float:
        """Mean product of what is complementary."""
        return self.gap / (2 * self.above.size + self.slack.size)

    def objective(self, problem: L1Problem) -> float:
        return float((self.above[0] + self.below[0]) @ problem.weights) + self.top

    def moved(self, step: _Point, primal: float, dual: float) -> _Point:
        return _Point(
            theta=self.theta + primal * step.theta,
            above=self.above + primal * step.above,
            below=self.below + primal * step.below,
            top=self.top + primal * step.top,
            slack=self.slack + primal * step.slack,
            y=self.y + dual * step.y,
            multiplier=self.multiplier + dual * step.multiplier,
            zp=self.zp + dual * step.zp,
            zq=self.zq + dual * step.zq,
        )

    def reach(self, step: _Point) -> tuple[float, float]:
        """Longest primal and dual parts of a step that keep everything positive, at most 1."""
        primal = [
            (self.above, step.above),
            (self.below, step.below),
            (self.slack, step.slack),
        ]
        dual = [(self.zp, step.zp), (self.zq, step.zq), (self.multiplier, step.multiplier)]
        return min(map(_reach, *zip(*primal, strict=True))), min(
            map(_reach, *zip(*dual, strict=True))
        )


def _reach(value: FloatArray, change: FloatArray) -> float:
    falling = change < 0
    return float(np.min(value[falling] / -change[falling], initial=1.0))


def _improved(problem: L1Problem, point: _Point) -> _Point | None:
    """Predictor and corrector; None where rounding stops them."""
    newton = _Newton(problem, point)
    try:
        aim = newton.step(0.0, None)
        ahead = point.moved(aim, *point.reach(aim))
        centring = (ahead.gap / point.gap) ** 3
        step = newton.step(centring * point.centre, aim)
    except np.linalg.LinAlgError:
        return None
    primal, dual = (_TO_THE_EDGE * reach for reach in point.reach(step))
    if not min(primal, dual) > _LEAST_STEP:
        return None
    return point.moved(step, primal, dual)


class _Newton:
    """Newton's equations at a point, reduced to (theta, lambda, s, multipliers of equations)."""

    def __init__(self, problem: L1Problem, point: _Point) -> None:
        self._problem, self._point = problem, point
        slopes, w = problem.slopes, problem.weights
        self._p, self._q = point.above / point.zp, point.below / point.zq
        self._e = 1 / (self._p + self._q)
        k, count, e = slopes.shape[2], len(slopes) - 1, len(problem.equal_slope)
        weighted = slopes * self._e[:, :, None]
        hessian = weighted.reshape(-1, k).T @ slopes.reshape(-1, k)
        lean = (self._p - self._q) * w
        self._mixed = np.einsum('rik,ri->rk', weighted, lean)[1:]
        stiff = (4 * self._p * self._q * self._e)[1:] @ w**2 + point.slack / point.multiplier
        matrix = np.zeros((k + count + 1 + e,) * 2)
        matrix[:k, :k] = hessian + _RIDGE * np.diag(np.diag(hessian))
        matrix[:k, k : k + count] = self._mixed.T
        matrix[k : k + count, :k] = self._mixed
        matrix[k : k + count, k : k + count] = -np.diag(stiff)
        matrix[k : k + count, k + count] = matrix[k + count, k : k + count] = -1.0
        matrix[:k, k + count + 1 :] = problem.equal_slope.T
        matrix[k + count + 1 :, :k] = problem.equal_slope
        self._scale = 1 / np.sqrt(np.maximum(np.abs(matrix).max(axis=0), 1e-300))
        self._matrix = matrix * self._scale[:, None] * self._scale
        self._lean = self._p - self._q

    def step(self, centre: float, aim: _Point | None) -> _Point:
        """Step towards products of size `centre`, with the second order of a first step."""
        problem, point = self._problem, self._point
        slopes, w = problem.slopes, problem.weights
        k, count = slopes.shape[2], len(slopes) - 1
        rp, rq = centre - point.above * point.zp, centre - point.below * point.zq
        rs = centre - point.slack * point.multiplier
        if aim is not None:
            rp, rq = rp - aim.above * aim.zp, rq - aim.below * aim.zq
            rs = rs - aim.slack * aim.multiplier
        hp, hq = rp / point.zp, rq / point.zq
        residual = slopes @ point.theta + problem.offsets
        re = -(residual - point.above + point.below) + hp - hq
        rt = -(point.top - (point.above[1:] + point.below[1:]) @ w - point.slack)
        gradient = -np.tensordot(point.y - self._e * re, slopes, axes=2)
        totals = (hp + hq - self._lean * self._e * re)[1:] @ w + rt + rs / point.multiplier
        right = np.concatenate(
            [
                gradient,
                -totals,
                [point.multiplier.sum() - 1.0],
                -(problem.equal_slope @ point.theta + problem.equal_offset),
            ]
        )
        found = np.linalg.solve(self._matrix, right * self._scale) * self._scale
        if not np.isfinite(found).all():
            raise np.linalg.LinAlgError('singular')
        theta, multiplier, top = found[:k], found[k : k + count], float(found[k + count])
        grown = np.concatenate([[0.0], multiplier])[:, None] * w
        y = self._e * (slopes @ theta - re + self._lean * grown)
        return _Point(
            theta=theta,
            above=hp - self._p * (grown - y),
            below=hq - self._q * (grown + y),
            top=top,
            slack=(rs - point.slack * multiplier) / point.multiplier,
            y=y,
            multiplier=multiplier,
            zp=grown - y,
            zq=grown + y,
        )
