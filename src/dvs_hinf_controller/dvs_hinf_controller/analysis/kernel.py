"""Impulse responses at unevenly spaced times, with a bound on what lies between and beyond."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import ComplexArray

_MAX_VALUES = 3_000_000
_MAX_NODES = 500_000
_BLOCK, _LONGEST_BLOCK = 16, 1024
_MAX_PASSES = 8
_LOOSER = (1.0, 8.0, 40.0, 150.0)
_QUADRATURE_SHARE = 0.75
_WORST_CONDITION = 1e10
_FLOORS = (1e-6, 1e-3, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernel:
    """Impulse response, and what its trapezoidal sums may miss.

    Parameters
    ----------
    times
        Shape (N,), s, from 0.
    values
        Responses, shape (P, N S, p): P phases, S start vectors, p outputs.
    weights
        Weights of the integral, shape (N S,).
    slop
        Bound of quadrature error and tail of every output's ``integral |g|``, shape (p,).
    state_quadrature
        Bound of ``| integral |v'g| - sum weights |v'g| |`` up to the last time, for any unit v
        over the outputs that are states.
    state_tail
        Bound of ``integral ||g||`` beyond the last time, over the same outputs.
    """

    times: FloatArray
    values: FloatArray
    weights: FloatArray
    slop: FloatArray
    state_quadrature: float
    state_tail: float


class Flow(Protocol):
    """A linear flow ``x -> exp(a t) x``, or its powers where time is discrete."""

    curve: FloatArray
    per_second: float

    def bounds(self, outputs: FloatArray, states: int) -> list[Bound]:
        """Bounds on all that follows from a state.

        Parameters
        ----------
        outputs
            Shape (P, p, size).
        states
            How many of the first outputs are states.
        """

    def step(self, allowed_s: float) -> Step:
        """Longest step that this flow can take.

        Parameters
        ----------
        allowed_s
            Upper limit, s.
        """

    def weights(self, times: FloatArray) -> FloatArray:
        """Weights of nodes in the integral or sum.

        Parameters
        ----------
        times
            Ascending, shape (N,), s.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step of a flow.

    Parameters
    ----------
    length
        s.
    transition
        Its map.
    exact
        Whether nothing lies between its ends.
    """

    length: float
    transition: FloatArray
    exact: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """``|outputs x(s)| <= gains |coordinates x| exp(-rates s)`` for s >= 0.

    ``coordinates`` has orthogonal groups of rows where it is not modal: then one gain and one rate
    serve the Euclidean norm of all of them.

    Parameters
    ----------
    coordinates
        Shape (q, size).
    gains
        Shape (1 + p, modes): of the norm of the states, then of every output.
    rates
        Shape (modes,), 1/s.
    """

    coordinates: ComplexArray
    gains: FloatArray
    rates: FloatArray

    def size(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Bound of the weighted sum over the columns, now and later, shape (1 + p,).

        Parameters
        ----------
        columns
            States, shape (size, S).
        weights
            Shape (S,).
        """
        return np.asarray(self.gains @ (self._magnitudes(columns) @ weights))

    def tail(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Bound of its integral over all later times, shape (1 + p,).

        Parameters
        ----------
        columns
            States, shape (size, S).
        weights
            Shape (S,).
        """
        return np.asarray((self.gains / self.rates) @ (self._magnitudes(columns) @ weights))

    def _magnitudes(self, columns: FloatArray) -> FloatArray:
        y = np.abs(self.coordinates @ columns)
        if self.gains.shape[1] == len(y):
            return np.asarray(y)
        return np.asarray(np.linalg.norm(y, axis=0, keepdims=True))


def output_gains(outputs: ComplexArray | FloatArray, states: int, *, whole: bool) -> FloatArray:
    """Largest gain of every mode over the phases, shape (1 + p, modes); see `Bound`.

    Parameters
    ----------
    outputs
        Output rows in the coordinates of the bound, shape (P, p, modes).
    states
        How many of the first outputs are states.
    whole
        Whether the modes share one norm.
    """
    if whole:
        norms = np.array([np.linalg.norm(rows[:states], 2) for rows in outputs])
        rows = np.linalg.norm(outputs, axis=2)
        return np.asarray(np.append(norms.max(), rows.max(axis=0))[:, None] * (1 + 1e-9))
    norms = np.linalg.norm(outputs[:, :states], axis=1).max(axis=0)
    return np.asarray(np.vstack([norms, np.abs(outputs).max(axis=0)]) * (1 + 1e-6))


class ContinuousFlow:
    """``x' = a x``.

    Parameters
    ----------
    a
        Stable, shape (size, size), 1/s.
    """

    def __init__(self, a: FloatArray) -> None:
        self._a = a
        self.curve = a @ a
        self.per_second = 1.0
        self._base = 0.1 / float(np.min(-np.linalg.eigvals(a).real))
        self._transitions: dict[int, FloatArray] = {}

    def bounds(self, outputs: FloatArray, states: int) -> list[Bound]:
        """Modal bound where the modes are well conditioned, and one by a Lyapunov function.

        Parameters
        ----------
        outputs
            Shape (P, p, size).
        states
            How many of the first outputs are states.
        """
        poles, vectors = np.linalg.eig(self._a)
        found = modal_bound(vectors, -poles.real, outputs, states)
        rate = -0.5 * float(np.max(poles.real))
        shifted = self._a + rate * np.eye(len(self._a))
        for floor in _FLOORS:
            p = scipy.linalg.solve_continuous_lyapunov(shifted.T, -stacked_outputs(outputs, floor))
            p = (p + p.T) / 2
            if _is_semidefinite(-shifted.T @ p - p @ shifted) and (
                bound := quadratic_bound(p, rate, outputs, states)
            ):
                return [*found, bound]
        return found

    def step(self, allowed_s: float) -> Step:
        """Longest step by a power of two, at most a tenth of the slowest time constant.

        Parameters
        ----------
        allowed_s
            s.
        """
        level = max(0, math.ceil(math.log2(self._base / allowed_s))) if allowed_s > 0 else 0
        length = self._base / 2.0**level
        if level not in self._transitions:
            self._transitions[level] = scipy.linalg.expm(self._a * length)
        return Step(length=length, transition=self._transitions[level], exact=False)

    def weights(self, times: FloatArray) -> FloatArray:
        """Trapezoidal weights, s.

        Parameters
        ----------
        times
            Ascending, shape (N,), s.
        """
        return trapezoidal_weights(times)


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


def modal_bound(
    vectors: ComplexArray, rates: FloatArray, outputs: FloatArray, states: int
) -> list[Bound]:
    """The bound by modes, if their vectors are well conditioned.

    Parameters
    ----------
    vectors
        Eigenvectors, shape (size, size).
    rates
        Decay of every mode, 1/s.
    outputs
        Shape (P, p, size).
    states
        How many of the first outputs are states.
    """
    if np.linalg.cond(vectors) > _WORST_CONDITION:
        return []
    gains = output_gains(outputs @ vectors, states, whole=False)
    inverse = np.asarray(np.linalg.inv(vectors), dtype=np.complex128)
    return [Bound(coordinates=inverse, gains=gains, rates=rates)]


def quadratic_bound(p: FloatArray, rate: float, outputs: FloatArray, states: int) -> Bound | None:
    """The bound by a Lyapunov function ``x'P x`` that decays at twice `rate`; None unless P > 0.

    Parameters
    ----------
    p
        Shape (size, size).
    rate
        1/s.
    outputs
        Shape (P, p, size).
    states
        How many of the first outputs are states.
    """
    if not np.linalg.eigvalsh(p)[0] > 0:
        return None
    root = np.linalg.cholesky(p).T
    gains = output_gains(outputs @ np.linalg.inv(root), states, whole=True)
    return Bound(coordinates=root.astype(np.complex128), gains=gains, rates=np.array([rate]))


def stacked_outputs(outputs: FloatArray, floor: float) -> FloatArray:
    """``C'C`` of all outputs, and a share of its size more, so that it is positive definite.

    Parameters
    ----------
    outputs
        Shape (P, p, size).
    floor
        The share.
    """
    rows = outputs.reshape(-1, outputs.shape[-1])
    extra = floor * float(np.linalg.norm(rows)) ** 2 / len(outputs)
    return np.asarray(rows.T @ rows + extra * np.eye(rows.shape[1]))


def _is_semidefinite(matrix: FloatArray) -> bool:
    return bool(np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix)[0] >= 0)


def sample_kernel(
    flow: Flow,
    *,
    starts: FloatArray,
    start_weights: FloatArray,
    outputs: FloatArray,
    states: int,
    rtol: float,
) -> Kernel | None:
    """Sample densely enough for the L1 norm of the first `states` outputs.

    Between two times a function differs from its chord by at most ``M s (tau - s) / 2``, M a bound
    of its second derivative, so that ``integral |f|`` exceeds the trapezoid of ``|f|`` by at most
    ``M tau^3 / 12``. M, and the tail, come from the modes or a Lyapunov function.

    Parameters
    ----------
    flow
        Stable flow.
    starts
        States that an impulse leaves, shape (size, S).
    start_weights
        Weight of each in the integral, shape (S,).
    outputs
        Output rows at every phase, shape (P, p, size).
    states
        How many of the first outputs count for the accuracy.
    rtol
        Wanted bound of the errors, relative to ``integral ||g||``. Where that would take too many
        times, the kernel's own error bounds tell what was reached.

    Returns
    -------
    Kernel or None
        None where no bound of the second derivative is known, or the loop decays too slowly.
    """
    sampler = _Sampler(
        flow=flow,
        bounds=flow.bounds(outputs, states),
        starts=starts,
        start_weights=start_weights,
        outputs=outputs,
        states=states,
    )
    if not sampler.bounds:
        return None
    for looser in _LOOSER:
        if (kernel := sampler.refined(looser * rtol)) is not None:
            return kernel
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sampler:
    """A flow, where it starts and what is seen of it."""

    flow: Flow
    bounds: list[Bound]
    starts: FloatArray
    start_weights: FloatArray
    outputs: FloatArray
    states: int

    def refined(self, rtol: float) -> Kernel | None:
        """Kernel with a chord error of about `rtol`, by ever shorter chords."""
        best, density = None, 1.0
        for _ in range(_MAX_PASSES):
            kernel = self.march(density * rtol, rtol)
            if kernel is None:
                return best
            total = float(
                np.linalg.norm(kernel.values[0, :, : self.states], axis=1) @ kernel.weights
            )
            best, error = kernel, kernel.state_quadrature
            if error <= _QUADRATURE_SHARE * rtol * total:
                break
            density *= min(0.8 * _QUADRATURE_SHARE * rtol * total / error, 0.5)
        return best

    def march(self, chord: float, truncation: float) -> Kernel | None:
        """March with steps that are powers of two, each as long as its chord error allows."""
        flow, x, block = self.flow, self.starts, _BLOCK
        times, states, count = [np.zeros(1)], [x[None]], 1
        error, total, last = np.zeros(1 + self.outputs.shape[1]), 0.0, math.nan
        powers: FloatArray | None = None
        limit = min(_MAX_NODES, _MAX_VALUES // max(x.size, 1))
        while count < limit:
            size, tail = self._smallest(Bound.size, x), self._smallest(Bound.tail, x)
            if tail[0] * flow.per_second <= (1 - _QUADRATURE_SHARE) * truncation * total:
                nodes = np.concatenate(times)
                return self._kernel(nodes, np.concatenate(states), error, tail * flow.per_second)
            # Its bound holds for all later times, so that one serves a block of equal steps.
            curvature = self._smallest(Bound.size, flow.curve @ x)
            allowed = (
                math.sqrt(12 * chord * size[0] / curvature[0]) if curvature[0] > 0 else math.inf
            )
            step = flow.step(allowed)
            block = min(2 * block, _LONGEST_BLOCK) if step.length == last else _BLOCK
            if powers is None or step.length != last or len(powers) != block:
                powers = _powers(step.transition, block)
            last = step.length
            path = powers @ x
            x = path[-1]
            times.append(times[-1][-1] + step.length * np.arange(1, block + 1))
            states.append(path)
            count += block
            if not step.exact:
                error = error + block * flow.per_second * curvature * step.length**3 / 12
            seen = np.linalg.norm(self.outputs[0, : self.states] @ path, axis=1)
            total += flow.per_second * step.length * float(np.sum(seen @ self.start_weights))
        return None

    def _smallest(
        self, measure: Callable[[Bound, FloatArray, FloatArray], FloatArray], x: FloatArray
    ) -> FloatArray:
        measured = [measure(bound, x, self.start_weights) for bound in self.bounds]
        return np.asarray(np.min(measured, axis=0))

    def _kernel(
        self, times: FloatArray, states: FloatArray, error: FloatArray, tail: FloatArray
    ) -> Kernel:
        nodes, size, count = states.shape
        flat = np.ascontiguousarray(np.moveaxis(states, 1, 2)).reshape(nodes * count, size)
        return Kernel(
            times=times,
            values=flat @ np.swapaxes(self.outputs, 1, 2),
            weights=np.outer(self.flow.weights(times), self.start_weights).ravel(),
            slop=(error + tail)[1:],
            state_quadrature=float(error[0]),
            state_tail=float(tail[0]),
        )


def _powers(matrix: FloatArray, count: int) -> FloatArray:
    """Powers 1 to `count`, a power of two, shape (count, size, size)."""
    powers = matrix[None]
    while len(powers) < count:
        powers = np.concatenate([powers, powers @ powers[-1]])
    return powers
