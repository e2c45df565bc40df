"""Peak gains (L1 norms of impulse responses) of the continuous loop, as upper bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.directions import WeightedVectors, largest_integral
from dvs_hinf_controller.analysis.flows import ContinuousFlow
from dvs_hinf_controller.analysis.kernel import Kernel, sample_kernel
from dvs_hinf_controller.state_space import StateSpace, balanced, weighted


@dataclass(frozen=True, slots=True, kw_only=True)
class PeakGains:
    """``limsup |c'x|`` and ``limsup ||x||`` for every disturbance with ``|w| <= 1``.

    Parameters
    ----------
    state
        N_G, upper bound of ``max_v integral |v'W g(t)| dt`` over unit vectors v.
    state_lower
        What a constructed direction attains, a lower bound of the same.
    output
        N_T, upper bound of ``integral |c'g(t)| dt``.
    output_lower
        Lower bound of the same.
    """

    state: float
    state_lower: float
    output: float
    output_lower: float


def peak_gains(
    g: StateSpace,
    output_vector: FloatArray,
    *,
    weights: FloatArray | None = None,
    rtol: float = 2e-4,
) -> PeakGains:
    """Peak gains from w to x and to ``c'x``, never too small.

    Parameters
    ----------
    g
        G, without feedthrough, from the mean disturbance to x.
    output_vector
        c, shape (n,).
    weights
        W of the error ``||W x||``, shape (n,); None for all 1.
    rtol
        Relative width that is aimed at, one-sided. In more than two dimensions the maximum over
        the direction is bounded by a relaxation, which may be wider.

    Returns
    -------
    PeakGains
        Infinite upper bounds if `g` is unstable, or so ill-conditioned that double precision gives
        no bound. Zero where no feedback answers w and the plant is stable by itself.
    """
    infinite = PeakGains(state=math.inf, state_lower=0.0, output=math.inf, output_lower=0.0)
    if g.abscissa >= 0:
        return infinite
    if not np.any(g.b) or not np.any(g.c):
        return PeakGains(state=0.0, state_lower=0.0, output=0.0, output_lower=0.0)
    kernel = impulse_response(g, output_vector, weights=weights, rtol=rtol / 2)
    if kernel is None:
        return infinite
    n = len(g.c)
    values, weights = kernel.values[0], kernel.weights
    output = float(weights @ np.abs(values[:, n]))
    state = largest_integral(WeightedVectors(values=values[:, :n], weights=weights))
    slop = kernel.state_quadrature + kernel.state_tail
    return PeakGains(
        state=state.upper + slop,
        state_lower=max(state.lower - kernel.state_quadrature, 0.0),
        output=output + float(kernel.slop[n]),
        output_lower=max(output - float(kernel.slop[n]), 0.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelGains:
    """Peak gains of every pixel group (docs/pixel_groups.md); never too small.

    Parameters
    ----------
    state
        N_G from the mean disturbance of every group to ``W x``, shape (k,).
    output
        N_T from the mean disturbance of group j to ``c_i'x``, shape (k, k).
    """

    state: FloatArray
    output: FloatArray

    @classmethod
    def of_one(cls, gains: PeakGains) -> ChannelGains:
        """Gains of the only group.

        Parameters
        ----------
        gains
            N_G and N_T.
        """
        return cls(state=np.array([gains.state]), output=np.array([[gains.output]]))

    def amplified(self, constant: FloatArray, share: FloatArray) -> FloatArray | None:
        """Bounds of disturbances ``|w_i| <= constant_i + share_i |c_i'x|``; None if none hold.

        The least solution of ``w = constant + share N_T w``, which there is where the spectral
        radius of the nonnegative matrix ``share N_T`` is below one.

        Parameters
        ----------
        constant
            Shape (k,).
        share
            Shape (k,).
        """
        if not (np.isfinite(self.output).all() and np.isfinite(self.state).all()):
            return None
        loop = share[:, None] * self.output
        if loop.size == 1:
            left = 1 - loop[0, 0]
            return constant / left if left > 0 else None
        if np.max(np.abs(np.linalg.eigvals(loop))) >= 1:
            return None
        return np.asarray(np.linalg.solve(np.eye(share.size) - loop, constant))

    @property
    def together(self) -> PeakGains:
        """Gains of all disturbances together, each with ``|w_j| <= 1``."""
        return PeakGains(
            state=float(self.state.sum()),
            state_lower=0.0,
            output=float(self.output.sum(axis=1).max()),
            output_lower=0.0,
        )


def channel_gains(
    g: StateSpace,
    gradients: FloatArray,
    *,
    weights: FloatArray | None = None,
    rtol: float = 2e-4,
) -> ChannelGains:
    """Peak gains from the mean disturbance of every group to x and to the luminosities.

    Parameters
    ----------
    g
        G, without feedthrough, a column a group.
    gradients
        A row a group, shape (k, n).
    weights
        W of the error ``||W x||``, shape (n,); None for all 1.
    rtol
        Relative width that is aimed at, one-sided.
    """
    if len(gradients) == 1:
        return ChannelGains.of_one(peak_gains(g, gradients[0], weights=weights, rtol=rtol))
    k, n = len(gradients), len(g.c)
    state, output = np.full(k, math.inf), np.full((k, k), math.inf)
    if g.order and float(np.max(g.poles().real)) >= 0:
        return ChannelGains(state=state, output=output)
    for j in range(k):
        column = replace(g, b=g.b[:, [j]], d=g.d[:, [j]])
        if not np.any(column.b):
            state[j], output[:, j] = 0.0, 0.0
            continue
        kernel = impulse_response(column, gradients, weights=weights, rtol=rtol / 2)
        if kernel is not None:
            values = kernel.values[0]
            vectors = WeightedVectors(values=values[:, :n], weights=kernel.weights)
            slop = kernel.state_quadrature + kernel.state_tail
            state[j] = largest_integral(vectors).upper + slop
            output[:, j] = kernel.weights @ np.abs(values[:, n:]) + kernel.slop[n:]
    return ChannelGains(state=state, output=output)


def impulse_response(
    g: StateSpace,
    output_vector: FloatArray,
    *,
    weights: FloatArray | None = None,
    rtol: float,
) -> Kernel | None:
    """Sampled response of W x, and of every ``c'x`` as the last outputs; see `sample_kernel`.

    Parameters
    ----------
    g
        G, stable, without feedthrough, one input.
    output_vector
        c, shape (n,), or a row a group, (k, n).
    weights
        W, shape (n,); None for all 1.
    rtol
        Wanted bound of the errors, relative to ``integral ||g||``.
    """
    g = balanced(g)
    return sample_kernel(
        ContinuousFlow(g.a),
        starts=g.b,
        start_weights=np.ones(1),
        outputs=np.vstack([weighted(g, weights).c, output_vector @ g.c])[None],
        states=len(g.c),
        rtol=rtol,
    )
