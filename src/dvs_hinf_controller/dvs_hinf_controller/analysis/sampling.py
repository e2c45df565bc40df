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
# Periods that are tried together.
_AT_ONCE = 10


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
    return bool(SampledLoop.of(model, controller).is_stable_at(np.array(period)))


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledLoop:
    """One period of the nodes' own scheme, as maps of (x, xc) at the samples.

    The plant holds ``u_k`` over the period; K is advanced exactly; ``u_k = Cc xc_k + Dc c'x_k``
    (the limit of a fine event threshold).

    Parameters
    ----------
    model
        Plant, n states and m inputs.
    controller
        K, k states.
    flow
        Generator of (x, u, xc) within a period, shape (n + m + k, n + m + k).
    start
        (x, u, xc) at its start from (x, xc), shape (n + m + k, n + k).
    kept
        Places of (x, xc) in (x, u, xc), shape (n + k,).
    """

    model: PlantModel
    controller: LinearController
    flow: FloatArray
    start: FloatArray
    kept: NDArray[np.intp]

    @classmethod
    def of(cls, model: PlantModel, controller: LinearController) -> SampledLoop:
        """Loop of a plant and a controller.

        Parameters
        ----------
        model
            Plant.
        controller
            K.
        """
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

    def is_stable_at(self, periods: FloatArray) -> NDArray[np.bool_]:
        """Whether the loop is stable with each of the periods, and either of the two maps.

        Parameters
        ----------
        periods
            Sampling periods, s, shape (...).
        """
        flows = self.flow_over(periods)
        interpolated = self.interpolated_map(flows, periods)
        return np.asarray(
            np.maximum(_spectral_radii(self.map(flows)), _spectral_radii(interpolated)) < 1
        )

    def flow_over(self, periods: FloatArray) -> FloatArray:
        """Where (x, u, xc) go within a period, shape (..., n + m + k, n + m + k).

        Parameters
        ----------
        periods
            Sampling periods, s, shape (...).
        """
        return _expm(np.multiply.outer(periods, self.flow))

    def map(self, flows: FloatArray) -> FloatArray:
        """Map of (x, xc) where K sees ``c'x(t)`` all along, shape (..., n + k, n + k).

        Parameters
        ----------
        flows
            What `flow_over` gives for the periods.
        """
        return (flows @ self.start)[..., self.kept, :]

    def interpolated_map(self, flows: FloatArray, periods: FloatArray) -> FloatArray:
        """Map of (x, xc) where K sees a straight line between samples, as the camera shows it.

        There it is a logarithm, which is a straight line, too, near the set-point. K is driven by
        c'x of the sample, and by its growth up to the next one.

        Parameters
        ----------
        flows
            What `flow_over` gives for the periods.
        periods
            Sampling periods, s, shape (...).
        """
        n, k, c = self.model.state_count, self.controller.order, self.model.gradients
        inputs, groups = self.model.input_count, len(c)
        # The plant's flow does not depend on xc.
        states = flows[..., :n, : n + inputs] @ self.start[: n + inputs]
        now = c @ np.eye(n, n + k)
        drive = np.zeros((*periods.shape, *(k + 2 * groups,) * 2))
        drive[..., :k, :k] = np.multiply.outer(periods, self.controller.state_matrix)
        drive[..., :k, k : k + groups] = np.multiply.outer(periods, self.controller.input_matrix)
        drive[..., k : k + groups, k + groups :] = np.eye(groups)
        seen = np.empty((*periods.shape, k + 2 * groups, n + k))
        seen[..., :k, :] = np.eye(k, n + k, n)
        seen[..., k : k + groups, :] = now
        seen[..., k + groups :, :] = c @ states - now
        return np.concatenate([states, _expm(drive)[..., :k, :] @ seen], axis=-2)


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
    loop = SampledLoop.of(model, controller)
    rates = np.abs(
        np.linalg.eigvals(scipy.linalg.block_diag(model.state_matrix, controller.state_matrix))
    )
    fastest = max(float(rates.max()), 1e-6)
    slowest = max(float(rates[rates > 0].min(initial=fastest)), 1e-6)
    low, end = 1e-3 / fastest, 1e3 / slowest
    while not loop.is_stable_at(np.array(low)):
        low /= 10
        if low < _SHORTEST / fastest:
            return 0.0
    longer = (10 ** (1 / _STEPS_PER_DECADE),) * _AT_ONCE
    while low <= end:
        grid = np.asarray(np.cumprod([low, *longer]), dtype=np.float64)
        too_long = ~loop.is_stable_at(grid[1:]) & (grid[:-1] <= end)
        if too_long.any():
            first = int(np.argmax(too_long))
            return _edge(loop, *grid[first : first + 2].tolist())
        low = float(grid[-1])
    return math.inf


def _edge(loop: SampledLoop, low: float, high: float) -> float:
    """Where between a stable and an unstable period stability ends, to a thousandth."""
    while high > low * 1.001:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if loop.is_stable_at(np.array(middle)) else (low, middle)
    return low


def _spectral_radii(matrices: FloatArray) -> FloatArray:
    """Spectral radius of each matrix, infinite for one that has overflowed."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    sound = np.where(finite[..., None, None], matrices, 0.0)
    return np.where(finite, np.abs(np.linalg.eigvals(sound)).max(axis=-1), math.inf)


def _expm(matrices: FloatArray) -> FloatArray:
    return np.asarray(scipy.linalg.expm(matrices), dtype=np.float64)
