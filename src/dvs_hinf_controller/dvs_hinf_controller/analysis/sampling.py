"""The longest sampling period at which the loop of the nodes is stable."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController

_STEPS_PER_DECADE = 20
_SHORTEST = 1e-8


def sampled_matrix(
    model: PlantModel, controller: LinearController, period: float, *, interpolates: bool = False
) -> FloatArray:
    """One period of the nodes' own scheme, as a map of (x, xc) at the samples.

    The plant holds ``u_k`` over the period; K sees ``c'x(t)`` all along and is advanced exactly;
    ``u_k = Cc xc_k + Dc c'x_k`` (the limit of a fine event threshold).

    Parameters
    ----------
    model
        Plant.
    controller
        K.
    period
        Sampling period, s.
    interpolates
        Whether K sees a straight line between the samples instead, as the simulated camera shows
        it: there a logarithm, which is a straight line, too, near the set-point.

    Returns
    -------
    FloatArray
        Shape (n + k, n + k).
    """
    loop = _SampledLoop.of(model, controller)
    return loop.interpolated_map(period) if interpolates else loop.map(period)


def is_stable_at(model: PlantModel, controller: LinearController, period: float) -> bool:
    """Whether the sampled loop is stable, with a sensor that sees all and one that interpolates.

    Parameters
    ----------
    model
        Plant.
    controller
        K.
    period
        Sampling period, s.
    """
    return _SampledLoop.of(model, controller).is_stable_at(period)


@dataclass(frozen=True, slots=True)
class _SampledLoop:
    """Flow of (x, u, xc) within a period, and (x, u, xc) at its start from (x, xc)."""

    model: PlantModel
    controller: LinearController
    flow: FloatArray
    start: FloatArray
    kept: NDArray[np.intp]

    @classmethod
    def of(cls, model: PlantModel, controller: LinearController) -> _SampledLoop:
        n, m, k = model.state_count, model.input_count, controller.order
        c = model.gradients
        flow = np.zeros((n + m + k, n + m + k))
        flow[:n, :n], flow[:n, n : n + m] = model.state_matrix, model.input_matrix
        flow[n + m :, :n] = controller.input_matrix @ c
        flow[n + m :, n + m :] = controller.state_matrix
        start = np.zeros((n + m + k, n + k))
        start[:n, :n], start[n + m :, n:] = np.eye(n), np.eye(k)
        start[n : n + m, :n] = controller.feedthrough_matrix @ c
        start[n : n + m, n:] = controller.output_matrix
        kept = np.delete(np.arange(n + m + k), np.arange(n, n + m))
        return cls(model=model, controller=controller, flow=flow, start=start, kept=kept)

    def is_stable_at(self, period: float) -> bool:
        return (
            _spectral_radius(self.map(period))
            < 1
            > _spectral_radius(self.interpolated_map(period))
        )

    def map(self, period: float) -> FloatArray:
        end = scipy.linalg.expm(self.flow * period) @ self.start
        return np.asarray(end[self.kept], dtype=np.float64)

    def interpolated_map(self, period: float) -> FloatArray:
        """K is driven by c'x of the sample, and by its growth up to the next one."""
        n, k, c = self.model.state_count, self.controller.order, self.model.gradients
        inputs, groups = self.model.input_count, len(c)
        plant = self.flow[: n + inputs, : n + inputs]
        state = scipy.linalg.expm(plant * period)[:n] @ self.start[: n + inputs]
        now = c @ np.eye(n, n + k)
        drive = np.zeros((k + 2 * groups,) * 2)
        drive[:k, :k] = self.controller.state_matrix
        drive[:k, k : k + groups] = self.controller.input_matrix
        drive[k : k + groups, k + groups :] = np.eye(groups) / period
        driven = scipy.linalg.expm(drive * period)[:k]
        return np.vstack([state, driven @ np.vstack([np.eye(k, n + k, n), now, c @ state - now])])


def max_sampling_period(model: PlantModel, controller: LinearController) -> float:
    """Longest period up to which every sampled loop is stable, s.

    Stability in the limit of a fine event threshold, and no more: what a period costs of the
    certified threshold is in the promise (docs/promise.md). Both with a sensor that sees the light
    all along and with one that interpolates its samples.

    Parameters
    ----------
    model
        Plant.
    controller
        K, stabilizing in continuous time.

    Returns
    -------
    float
        Zero only where rounding hides that the continuous loop is stable. Infinite if no period
        up to 1000 time constants of the slowest pole is too long.
    """
    stable = _SampledLoop.of(model, controller).is_stable_at
    rates = np.abs(
        np.linalg.eigvals(scipy.linalg.block_diag(model.state_matrix, controller.state_matrix))
    )
    fastest = max(float(rates.max()), 1e-6)
    slowest = max(float(rates[rates > 0].min(initial=fastest)), 1e-6)
    low, end = 1e-3 / fastest, 1e3 / slowest
    while not stable(low):
        low /= 10
        if low < _SHORTEST / fastest:
            return 0.0
    step = 10 ** (1 / _STEPS_PER_DECADE)
    while stable(low * step):
        low *= step
        if low > end:
            return math.inf
    high = low * step
    while high > low * 1.001:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _spectral_radius(matrix: FloatArray) -> float:
    if not np.isfinite(matrix).all():
        return math.inf
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))
