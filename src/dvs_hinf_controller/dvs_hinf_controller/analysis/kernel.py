"""Impulse responses at unevenly spaced times, with a bound on what lies between and beyond."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.directions import parts_of
from dvs_hinf_controller.analysis.flows import Flow
from dvs_hinf_controller.analysis.tail_bounds import Bound

_MAX_VALUES = 3_000_000
_MAX_NODES = 500_000
_BLOCK, _LONGEST_BLOCK = 16, 1024
_MAX_PASSES = 8
_LOOSER = (1.0, 8.0, 40.0, 150.0)
_QUADRATURE_SHARE = 0.75


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernel:
    """Impulse response, and what its trapezoidal sums may miss.

    Parameters
    ----------
    times
        Shape (N,), s, from 0.
    states
        States of the flow, shape (N S, size): S start vectors.
    outputs
        Output rows at every phase, shape (P, p, size).
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
    states: FloatArray
    outputs: FloatArray
    weights: FloatArray
    slop: FloatArray
    state_quadrature: float
    state_tail: float

    @property
    def values(self) -> FloatArray:
        """Responses, shape (P, N S, p)."""
        return self.states @ _columns(self.outputs)

    def summed(self, kept: int) -> Summed:
        """Sum all responses without holding them: many do not fit into a cache.

        Parameters
        ----------
        kept
            How many of the first outputs are held as well.
        """
        phases, p, _ = self.outputs.shape
        columns, sums = _columns(self.outputs), np.zeros((phases, p))
        values = np.empty((phases, len(self.states), kept))
        for part in parts_of(len(self.states), p):
            states, weights = self.states[part], self.weights[part]
            for phase in range(phases):
                found = states @ columns[phase]
                values[phase, part] = found[:, :kept]
                sums[phase] += weights @ np.abs(found, out=found)
        return Summed(values=values, sums=sums)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summed:
    """Weighted sums of absolute responses.

    Parameters
    ----------
    values
        Responses of the first outputs, shape (P, N S, kept).
    sums
        ``sum weights |values|`` of every output, shape (P, p).
    """

    values: FloatArray
    sums: FloatArray


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
        times, the kernel's own error bounds show what was reached.

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
class _Path:
    """States at unevenly spaced times, the bounds of what is missed, and ``integral ||g||``."""

    times: FloatArray
    states: FloatArray
    error: FloatArray
    tail: FloatArray
    total: float


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
            path = self.march(density * rtol, rtol)
            if path is None:
                break
            best, error = path, float(path.error[0])
            if error <= _QUADRATURE_SHARE * rtol * path.total:
                break
            density *= min(0.8 * _QUADRATURE_SHARE * rtol * path.total / error, 0.5)
        return None if best is None else self._kernel(best)

    def march(self, chord: float, truncation: float) -> _Path | None:
        """March with steps that are powers of two, each as long as its chord error allows."""
        flow, x, block = self.flow, self.starts, _BLOCK
        times, states, count = [np.zeros(1)], [x[None]], 1
        error, total, last = np.zeros(1 + self.outputs.shape[1]), 0.0, math.nan
        powers = np.empty((0, len(x), len(x)))
        limit = min(_MAX_NODES, _MAX_VALUES // max(x.size, 1))
        while count < limit:
            size, tail = self._smallest(Bound.size_and_tail, x)
            if tail[0] * flow.per_second <= (1 - _QUADRATURE_SHARE) * truncation * total:
                return _Path(
                    times=np.concatenate(times),
                    states=np.concatenate(states),
                    error=error,
                    tail=tail * flow.per_second,
                    total=total,
                )
            # Its bound holds for all later times, so that one serves a block of equal steps.
            curvature = self._smallest(Bound.size, flow.curve @ x)
            allowed = (
                math.sqrt(12 * chord * size[0] / curvature[0]) if curvature[0] > 0 else math.inf
            )
            step = flow.step(allowed)
            block = min(2 * block, _LONGEST_BLOCK) if step.length == last else _BLOCK
            powers = _powers(powers if step.length == last else step.transition[None], block)
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

    def _kernel(self, path: _Path) -> Kernel:
        nodes, size, count = path.states.shape
        flat = np.ascontiguousarray(np.moveaxis(path.states, 1, 2)).reshape(nodes * count, size)
        return Kernel(
            times=path.times,
            states=flat,
            outputs=self.outputs,
            weights=np.outer(self.flow.weights(path.times), self.start_weights).ravel(),
            slop=(path.error + path.tail)[1:],
            state_quadrature=float(path.error[0]),
            state_tail=float(path.tail[0]),
        )


def _columns(outputs: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.swapaxes(outputs, 1, 2))


def _powers(powers: FloatArray, count: int) -> FloatArray:
    """Powers of a matrix from 1 to `count`, a power of two, out of the first of them."""
    while len(powers) < count:
        powers = np.concatenate([powers, powers @ powers[-1]])
    return powers
