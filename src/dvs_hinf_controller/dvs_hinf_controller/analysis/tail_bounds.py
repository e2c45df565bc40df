"""Exponential bounds on all that follows from a state of a stable linear flow."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import ComplexArray

_WORST_CONDITION = 1e10
_FLOORS = (1e-6, 1e-3, 1.0)


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

    def size_and_tail(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """The same, and below it a bound of its integral over all later times, shape (2, 1 + p).

        Parameters
        ----------
        columns
            States, shape (size, S).
        weights
            Shape (S,).
        """
        seen = self._magnitudes(columns) @ weights
        return np.stack([self.gains @ seen, (self.gains / self.rates) @ seen])

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


def lyapunov_bound(
    outputs: FloatArray,
    states: int,
    rate: float,
    *,
    solve: Callable[[FloatArray], FloatArray],
    decrease: Callable[[FloatArray], FloatArray],
) -> Bound | None:
    """The bound by the first Lyapunov function that is confirmed; None if none is.

    Parameters
    ----------
    outputs
        Shape (P, p, size).
    states
        How many of the first outputs are states.
    rate
        Half of the rate at which the function decays, 1/s.
    solve
        Candidate P for the weight Q of its Lyapunov equation.
    decrease
        What P loses along the flow beyond that rate; P holds where this is semidefinite.
    """
    for floor in _FLOORS:
        # A candidate may be ill-conditioned: it is checked next.
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', scipy.linalg.LinAlgWarning)
            p = solve(stacked_outputs(outputs, floor))
        p = (p + p.T) / 2
        if _is_semidefinite(decrease(p)):
            bound = quadratic_bound(p, rate, outputs, states)
            if bound is not None:
                return bound
    return None


def _is_semidefinite(matrix: FloatArray) -> bool:
    return bool(np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix)[0] >= 0)


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
