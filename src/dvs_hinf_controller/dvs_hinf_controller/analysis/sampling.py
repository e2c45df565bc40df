"""The longest sampling period at which the loop of the nodes is stable with margin."""

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
_LOOP_GAINS = 5


def sampled_matrix(
    model: PlantModel, controller: LinearController, period: float, *, loop_gain: float = 1.0
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
    loop_gain
        Factor on what K measures; 1 is the nominal loop.

    Returns
    -------
    FloatArray
        Shape (n + k, n + k).
    """
    return _SampledLoop.of(model, controller, loop_gain).map(period)


@dataclass(frozen=True, slots=True)
class _SampledLoop:
    """Flow of (x, u, xc) within a period, and (x, u, xc) at its start from (x, xc)."""

    flow: FloatArray
    start: FloatArray
    kept: NDArray[np.intp]

    @classmethod
    def of(cls, model: PlantModel, controller: LinearController, gain: float) -> _SampledLoop:
        n, m, k = model.state_count, model.input_count, controller.order
        c = gain * model.output_vector[None, :]
        flow = np.zeros((n + m + k, n + m + k))
        flow[:n, :n], flow[:n, n : n + m] = model.state_matrix, model.input_matrix
        flow[n + m :, :n] = controller.input_vector[:, None] @ c
        flow[n + m :, n + m :] = controller.state_matrix
        start = np.zeros((n + m + k, n + k))
        start[:n, :n], start[n + m :, n:] = np.eye(n), np.eye(k)
        start[n : n + m, :n] = controller.feedthrough[:, None] @ c
        start[n : n + m, n:] = controller.output_matrix
        kept = np.delete(np.arange(n + m + k), np.arange(n, n + m))
        return cls(flow=flow, start=start, kept=kept)

    def map(self, period: float) -> FloatArray:
        end = scipy.linalg.expm(self.flow * period) @ self.start
        return np.asarray(end[self.kept], dtype=np.float64)


def max_sampling_period(
    model: PlantModel, controller: LinearController, *, gain_margin: float = 0.2
) -> float:
    """Longest period up to which every sampled loop is stable with margin, s.

    With margin: for every loop gain within ``1 -+ gain_margin``, which is how the sector of the
    events acts on the loop.

    Parameters
    ----------
    model
        Plant.
    controller
        K, stabilizing in continuous time.
    gain_margin
        Relative change of the loop gain that the sampled loop must bear.

    Returns
    -------
    float
        Zero if the continuous loop itself does not bear `gain_margin`; infinite if no period up
        to 1000 time constants of the slowest pole is too long.
    """
    loops = [
        _SampledLoop.of(model, controller, gain)
        for gain in np.linspace(1 - gain_margin, 1 + gain_margin, _LOOP_GAINS)
    ]

    def stable(period: float) -> bool:
        return all(_spectral_radius(loop.map(period)) < 1 for loop in loops)

    rates = np.abs(
        np.linalg.eigvals(scipy.linalg.block_diag(model.state_matrix, controller.state_matrix))
    )
    fastest = max(float(rates.max()), 1e-6)
    slowest = max(float(rates[rates > 0].min(initial=fastest)), 1e-6)
    low, end = 1e-3 / fastest, 1e3 / slowest
    if not stable(low):
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
