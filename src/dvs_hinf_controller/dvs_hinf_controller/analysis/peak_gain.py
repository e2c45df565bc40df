"""Peak gains (L1 norms of impulse responses) as upper bounds with every error added."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import ComplexArray, StateSpace

_MAX_NODES = 40_000
_BLOCK = 16
_MAX_PASSES = 8
_QUADRATURE_SHARE = 0.75
_WORST_CONDITION = 1e8
_SECTORS = 32
_PLANE_RTOL = 1e-5
_ASCENT_STARTS = 12
_ASCENT_STEPS = 100
_RELAXATION_STEPS = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class PeakGains:
    """``limsup |c'x|`` and ``limsup ||x||`` for every disturbance with ``|w| <= 1``.

    Parameters
    ----------
    state
        N_G, upper bound of ``max_v integral |v'g(t)| dt`` over unit vectors v.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledKernel:
    """Impulse response at unevenly spaced times, and what the trapezoidal rule may miss.

    Parameters
    ----------
    times
        Shape (N,), s, from 0.
    values
        g at these times, shape (N, n).
    weights
        Trapezoidal weights, shape (N,), s.
    quadrature_error
        Bound of ``| integral |v'g| - sum weights |v'g| |`` up to the last time, any unit v.
    tail
        Bound of ``integral ||g||`` beyond the last time.
    """

    times: FloatArray
    values: FloatArray
    weights: FloatArray
    quadrature_error: float
    tail: float

    def integral(self, directions: FloatArray) -> FloatArray:
        """Trapezoidal value of ``integral |v'g|`` for every column v.

        Parameters
        ----------
        directions
            Shape (n, k).
        """
        return np.asarray(self.weights @ np.abs(self.values @ directions))


def peak_gains(g: StateSpace, output_vector: FloatArray, *, rtol: float = 2e-4) -> PeakGains:
    """Peak gains from w to x and to ``c'x``, never too small.

    Between two times a function differs from its chord by at most ``M s (tau - s) / 2``, M a bound
    of its second derivative, so that ``integral |f|`` exceeds the trapezoid of ``|f|`` by at most
    ``M tau^3 / 12``. M, and the tail, come from the modes or a Lyapunov function of the loop.

    Parameters
    ----------
    g
        G, stable, without feedthrough, from the mean disturbance to x.
    output_vector
        c, shape (n,).
    rtol
        Relative width that is aimed at, one-sided. In more than two dimensions the maximum over
        the direction is bounded by a relaxation, which may be wider.

    Returns
    -------
    PeakGains
        Infinite upper bounds if `g` is unstable, or so ill-conditioned that double precision gives
        no bound.
    """
    zero = PeakGains(state=0.0, state_lower=0.0, output=0.0, output_lower=0.0)
    if not np.any(g.b) or not np.any(g.c):
        return zero
    infinite = PeakGains(state=math.inf, state_lower=0.0, output=math.inf, output_lower=0.0)
    if float(np.max(g.poles().real)) >= 0:
        return infinite
    kernel = sample_kernel(g, rtol=rtol / 2)
    if kernel is None:
        return infinite
    slop = kernel.quadrature_error + kernel.tail
    c_norm = float(np.linalg.norm(output_vector))
    output = float(kernel.integral(output_vector[:, None])[0])
    lower, upper = _largest_integral(kernel)
    return PeakGains(
        state=upper + slop,
        state_lower=max(lower - kernel.quadrature_error, 0.0),
        output=output + c_norm * slop,
        output_lower=max(output - c_norm * kernel.quadrature_error, 0.0),
    )


def sample_kernel(g: StateSpace, *, rtol: float) -> SampledKernel | None:
    """Sample the impulse response of `g` densely enough for its L1 norm.

    Parameters
    ----------
    g
        G, stable, without feedthrough.
    rtol
        Wanted bound of the errors, relative to ``integral ||g||``. Where that would take too many
        times, the kernel's own error bounds tell what was reached.

    Returns
    -------
    SampledKernel or None
        None where no bound of the second derivative is known.
    """
    bounds = [bound for bound in (_modal_bound(g), _lyapunov_bound(g)) if bound is not None]
    if not bounds:
        return None
    best, density = None, 1.0
    for _ in range(_MAX_PASSES):
        kernel = _sample(g, bounds, density * rtol, rtol)
        if kernel is None:
            return best
        total = float(kernel.weights @ np.linalg.norm(kernel.values, axis=1))
        best, error = kernel, kernel.quadrature_error
        if error <= _QUADRATURE_SHARE * rtol * total:
            break
        density *= min(0.8 * _QUADRATURE_SHARE * rtol * total / error, 0.5)
    return best


@dataclass(frozen=True, slots=True)
class _Bound:
    """``||c e^(a s) x|| <= sum_i gains_i |(coordinates x)_i| e^(-rates_i s)`` for s >= 0.

    ``coordinates`` has orthogonal groups of rows where it is not modal: then one gain and one rate
    serve the Euclidean norm of all of them.
    """

    coordinates: ComplexArray
    gains: FloatArray
    rates: FloatArray

    def size_and_tail(self, x: FloatArray) -> tuple[float, float]:
        parts = self.gains * self._magnitudes(x)
        return float(np.sum(parts)), float(np.sum(parts / self.rates))

    def _magnitudes(self, x: FloatArray) -> FloatArray:
        y = self.coordinates @ x
        return np.abs(y) if self.gains.size == y.size else np.array([np.linalg.norm(y)])


def _modal_bound(g: StateSpace) -> _Bound | None:
    poles, vectors = np.linalg.eig(g.a)
    if np.linalg.cond(vectors) > _WORST_CONDITION:
        return None
    return _Bound(
        coordinates=np.linalg.inv(vectors),
        gains=np.linalg.norm(g.c @ vectors, axis=0) * (1 + 1e-6),
        rates=-poles.real,
    )


def _lyapunov_bound(g: StateSpace) -> _Bound | None:
    """From ``(a + rate I)' P + P (a + rate I) <= 0``, P = root' root."""
    rate = -0.5 * float(np.max(g.poles().real))
    shifted = g.a + rate * np.eye(g.order)
    floor = 1e-6 * float(np.linalg.norm(g.c)) ** 2
    p = scipy.linalg.solve_continuous_lyapunov(shifted.T, -g.c.T @ g.c - floor * np.eye(g.order))
    p = (p + p.T) / 2
    slope = shifted.T @ p + p @ shifted
    if np.linalg.eigvalsh(p)[0] <= 0 or np.linalg.eigvalsh(slope)[-1] > 0:
        return None
    root = np.linalg.cholesky(p).T
    gain = float(np.linalg.norm(np.linalg.solve(root.T, g.c.T), 2)) * (1 + 1e-9)
    return _Bound(
        coordinates=root.astype(np.complex128), gains=np.array([gain]), rates=np.array([rate])
    )


def _sample(
    g: StateSpace, bounds: list[_Bound], chord: float, truncation: float
) -> SampledKernel | None:
    """March with steps that are powers of two, each as long as its chord error allows."""
    square = g.a @ g.a
    base = 0.1 / float(np.min(-g.poles().real))
    flows: dict[int, FloatArray] = {}
    x = g.b[:, 0].copy()
    times, states = [np.zeros(1)], [x[None, :]]
    error, total = 0.0, 0.0
    while len(times) * _BLOCK < _MAX_NODES:
        size, tail = (min(p) for p in zip(*(b.size_and_tail(x) for b in bounds), strict=True))
        if tail <= (1 - _QUADRATURE_SHARE) * truncation * total:
            nodes = np.concatenate(times)
            return SampledKernel(
                times=nodes,
                values=np.vstack(states) @ g.c.T,
                weights=trapezoidal_weights(nodes),
                quadrature_error=error,
                tail=tail,
            )
        # Its bound holds for all later times, so that one serves a block of equal steps.
        curvature = min(b.size_and_tail(square @ x)[0] for b in bounds)
        allowed = math.sqrt(12 * chord * size / curvature) if curvature > 0 else math.inf
        level = max(0, math.ceil(math.log2(base / allowed))) if allowed < base else 0
        step = base / 2.0**level
        if level not in flows:
            flows[level] = _powers(scipy.linalg.expm(g.a * step))
        block = flows[level] @ x
        x = block[-1]
        times.append(times[-1][-1] + step * np.arange(1, _BLOCK + 1))
        states.append(block)
        error += _BLOCK * curvature * step**3 / 12
        total += step * float(np.sum(np.linalg.norm(block @ g.c.T, axis=1)))
    return None


def _powers(matrix: FloatArray) -> FloatArray:
    powers = [matrix]
    for _ in range(_BLOCK - 1):
        powers.append(powers[-1] @ matrix)
    return np.array(powers)


def trapezoidal_weights(times: FloatArray) -> FloatArray:
    """Weights of the trapezoidal rule at uneven times, shape (N,).

    Parameters
    ----------
    times
        Ascending, shape (N,).
    """
    weights = np.zeros(times.size)
    weights[1:] += np.diff(times) / 2
    weights[:-1] += np.diff(times) / 2
    return weights


def _largest_integral(kernel: SampledKernel) -> tuple[float, float]:
    """Bracket of ``max_v sum weights |v'g|`` over unit vectors, a norm of v, hence convex."""
    n = kernel.values.shape[1]
    if n == 1:
        value = float(kernel.integral(np.ones((1, 1)))[0])
        return value, value
    if n == 2:
        return _largest_in_plane(kernel)
    v = steepest_direction(kernel)
    return float(kernel.integral(v[:, None])[0]), _relaxed_maximum(kernel, v)


def _largest_in_plane(kernel: SampledKernel) -> tuple[float, float]:
    """Bracket by bisecting sectors: inside one of half-width a, at most its ends' / cos(a)."""

    def values(angles: FloatArray) -> FloatArray:
        return kernel.integral(np.array([np.cos(angles), np.sin(angles)]))

    angles = np.linspace(0, math.pi, _SECTORS + 1)
    ends = values(angles)
    low, high = np.column_stack([angles[:-1], ends[:-1]]), np.column_stack([angles[1:], ends[1:]])
    best, settled = float(ends.max()), 0.0
    while low.size:
        cap = np.maximum(low[:, 1], high[:, 1]) / np.cos((high[:, 0] - low[:, 0]) / 2)
        is_open = cap > best * (1 + _PLANE_RTOL)
        settled = max(settled, float(np.max(cap[~is_open], initial=0.0)))
        low, high = low[is_open], high[is_open]
        middle = (low[:, 0] + high[:, 0]) / 2
        centre = np.column_stack([middle, values(middle)])
        best = max(best, float(np.max(centre[:, 1], initial=0.0)))
        low, high = np.vstack([low, centre]), np.vstack([centre, high])
    return best, max(settled, best)


def _relaxed_maximum(kernel: SampledKernel, v: FloatArray) -> float:
    """Upper bound of ``max_v sum w |v'g|``: by Cauchy and Schwarz, for any positive a,

    ``(sum w |v'g|)^2 <= (sum w a) v' (sum w g g' / a) v``. The best a is ``sqrt(g'S g)`` with S a
    density matrix, found by the multiplicative update of optimal experiment design.
    """
    n = v.size
    used = np.linalg.norm(kernel.values, axis=1) > 0
    values, weights = kernel.values[used], kernel.weights[used]
    s = 0.9 * np.outer(v, v) + 0.1 * np.eye(n) / n
    bound = math.inf
    for _ in range(_RELAXATION_STEPS):
        a = np.sqrt(np.einsum('ij,jk,ik->i', values, s, values))
        moment = (values * (weights / a)[:, None]).T @ values
        bound = min(bound, math.sqrt(float(weights @ a) * np.linalg.eigvalsh(moment)[-1]))
        root = scipy.linalg.sqrtm(s).real
        s = root @ moment @ root
        s = s / np.trace(s) + 1e-12 * np.eye(n)
    return bound


def steepest_direction(kernel: SampledKernel) -> FloatArray:
    """Unit vector v with a (locally) largest ``integral |v'g|``, shape (n,).

    Every step moves to the gradient's direction, which never lowers a convex function.

    Parameters
    ----------
    kernel
        Sampled impulse response.
    """
    weighted = kernel.weights[:, None] * kernel.values
    order = np.argsort(-np.linalg.norm(weighted, axis=1))[:_ASCENT_STARTS]
    starts = np.vstack([np.eye(kernel.values.shape[1]), weighted[order]])
    lengths = np.linalg.norm(starts, axis=1)
    v = (starts[lengths > 0] / lengths[lengths > 0, None]).T
    for _ in range(_ASCENT_STEPS):
        gradient = weighted.T @ np.sign(kernel.values @ v)
        moved = gradient / np.maximum(np.linalg.norm(gradient, axis=0), 1e-300)
        if np.allclose(moved, v, rtol=0, atol=1e-12):
            break
        v = moved
    return np.asarray(v[:, int(np.argmax(kernel.integral(v)))])
