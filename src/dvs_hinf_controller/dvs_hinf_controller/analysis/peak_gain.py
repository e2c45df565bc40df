"""Peak gains (L1 norms of impulse responses) of the continuous loop, as upper bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
    if g.order and float(np.max(g.poles().real)) >= 0:
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


def impulse_response(
    g: StateSpace,
    output_vector: FloatArray,
    *,
    weights: FloatArray | None = None,
    rtol: float,
) -> Kernel | None:
    """Sampled response of W x, and of ``c'x`` as the last output; see `sample_kernel`.

    Parameters
    ----------
    g
        G, stable, without feedthrough, one input.
    output_vector
        c, shape (n,).
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
