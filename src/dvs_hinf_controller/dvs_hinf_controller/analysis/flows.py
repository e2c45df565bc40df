"""Stable linear flows in steps, each with a bound on what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.tail_bounds import (
    Bound,
    lyapunov_bound,
    modal_bound,
)
from dvs_hinf_controller.state_space import lyapunov_solution


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
        confirmed = lyapunov_bound(
            outputs,
            states,
            rate,
            solve=lambda q: lyapunov_solution(shifted.T, -q),
            decrease=lambda p: -shifted.T @ p - p @ shifted,
        )
        return found if confirmed is None else [*found, confirmed]

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
