"""Exact response of a linear system to an input that is constant between given instants."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from dvs_common.arrays import FloatArray

# Eigenvectors worse conditioned than this would cost more than six of sixteen digits.
_WORST_CONDITION = 1e6


class HeldInputResponse:
    """``x' = A x + b e``: transition ``exp(A t)`` and response ``int_0^t exp(A s) b ds``.

    In modal coordinates both are elementwise, so many instants cost one vectorised call and stiff
    poles cost nothing. Where the eigenvectors are ill-conditioned (a defective A), one matrix
    exponential of ``[[A, b], [0, 0]]`` an instant takes their place (Van Loan, IEEE Transactions
    on Automatic Control 23(3), 1978).

    Parameters
    ----------
    state_matrix
        A, shape (k, k), 1/s.
    input_vector
        b, shape (k,).
    """

    def __init__(self, state_matrix: FloatArray, input_vector: FloatArray) -> None:
        k = input_vector.size
        self._augmented = np.zeros((k + 1, k + 1))
        self._augmented[:k, :k] = state_matrix
        self._augmented[:k, k] = input_vector
        self._poles, self._vectors = np.linalg.eig(state_matrix)
        self._modal = k > 0 and np.linalg.cond(self._vectors) < _WORST_CONDITION
        if self._modal:
            self._modal_input = np.linalg.solve(self._vectors, input_vector.astype(complex))
            self._inverse = np.linalg.inv(self._vectors)

    def transition(self, duration_s: float) -> FloatArray:
        """``exp(A t)``, shape (k, k).

        Parameters
        ----------
        duration_s
            t >= 0, s.
        """
        if self._modal:
            scaled = self._vectors * np.exp(self._poles * duration_s)
            return np.ascontiguousarray((scaled @ self._inverse).real)
        return np.ascontiguousarray(expm(self._augmented * duration_s)[:-1, :-1])

    def response(self, durations_s: FloatArray) -> FloatArray:
        """``int_0^t exp(A s) b ds`` for every t, shape (len(durations_s), k).

        Parameters
        ----------
        durations_s
            t >= 0, s.
        """
        if self._modal:
            growth = _expm1_over(self._poles, durations_s[:, None])
            return np.ascontiguousarray(((growth * self._modal_input) @ self._vectors.T).real)
        blocks = expm(self._augmented * durations_s[:, None, None])
        return np.ascontiguousarray(blocks[:, :-1, -1])


def _expm1_over(poles: np.ndarray, durations_s: FloatArray) -> np.ndarray:
    """``(exp(p t) - 1) / p``, and t where p is zero."""
    exponents = poles * durations_s
    safe = np.where(poles == 0, 1.0, poles)
    return np.where(poles == 0, durations_s, np.expm1(exponents) / safe)
