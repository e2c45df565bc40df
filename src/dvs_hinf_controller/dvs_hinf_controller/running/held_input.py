"""Exact response of a linear system to an input that is constant between given instants."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from dvs_common.arrays import FloatArray

# Eigenvectors worse conditioned than this would cost more than six of sixteen digits.
_WORST_CONDITION = 1e6
# Jumps from which on they are summed mode by mode.
MANY_JUMPS = 4096


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
        self.poles, self.vectors = np.linalg.eig(state_matrix)
        self.is_modal = k > 0 and np.linalg.cond(self.vectors) < _WORST_CONDITION
        if self.is_modal:
            self.modal_input = np.linalg.solve(self.vectors, input_vector.astype(complex))
            self._inverse = np.linalg.inv(self.vectors)

    def transition(self, duration_s: float) -> FloatArray:
        """``exp(A t)``, shape (k, k).

        Parameters
        ----------
        duration_s
            t >= 0, s.
        """
        if self.is_modal:
            scaled = self.vectors * np.exp(self.poles * duration_s)
            return np.ascontiguousarray((scaled @ self._inverse).real)
        return np.ascontiguousarray(expm(self._augmented * duration_s)[:-1, :-1])

    def response(self, durations_s: FloatArray) -> FloatArray:
        """``int_0^t exp(A s) b ds`` for every t, shape (len(durations_s), k).

        Parameters
        ----------
        durations_s
            t >= 0, s.
        """
        if self.is_modal:
            growth = _expm1_over(self.poles, durations_s[:, None])
            return np.ascontiguousarray(((growth * self.modal_input) @ self.vectors.T).real)
        blocks = expm(self._augmented * durations_s[:, None, None])
        return np.ascontiguousarray(blocks[:, :-1, -1])

    def jumped(self, jumps: FloatArray, durations_s: FloatArray) -> FloatArray:
        """``sum_e jump_e int_0^t_e exp(A s) b ds``, shape (k,).

        Of many jumps the sum comes first, so that few passes over them are left: the same number
        but for rounding.

        Parameters
        ----------
        jumps
            Jumps of the input, shape (E,).
        durations_s
            Times since each, s, shape (E,).
        """
        if len(jumps) < MANY_JUMPS or not self.is_modal:
            response: FloatArray = jumps @ self.response(durations_s)
            return response
        grown = np.empty(self.poles.size, np.complex128)
        for j, pole in enumerate(self.poles):
            # Complex poles of a real matrix come in pairs, the one with imag > 0 first.
            grown[j] = grown[j - 1].conj() if pole.imag < 0 else _grown(pole, jumps, durations_s)
        return np.ascontiguousarray((self.vectors @ (grown * self.modal_input)).real)


def _grown(pole: complex, jumps: FloatArray, durations_s: FloatArray) -> complex:
    """Sum of jumps times ``(exp(p t) - 1) / p``, in real arithmetic."""
    if pole == 0:
        return complex(jumps @ durations_s)
    growth = np.expm1(pole.real * durations_s)
    if pole.imag == 0:
        return complex(jumps @ growth) / pole
    # exp(a + ib) - 1 = expm1(a) cos b - 2 sin^2(b/2) + i (expm1(a) + 1) sin b
    half = 0.5 * pole.imag * durations_s
    sine, cosine = np.sin(half), np.cos(half)
    real = growth * (1 - 2 * sine * sine) - 2 * sine * sine
    imaginary = (growth + 1) * (2 * sine * cosine)
    return complex(jumps @ real, jumps @ imaginary) / pole


def _expm1_over(poles: np.ndarray, durations_s: FloatArray) -> np.ndarray:
    """``(exp(p t) - 1) / p``, and t where p is zero."""
    exponents = poles * durations_s
    safe = np.where(poles == 0, 1.0, poles)
    return np.where(poles == 0, durations_s, np.expm1(exponents) / safe)
