"""The scalar s and its derivatives at an instant."""

from __future__ import annotations

import numpy as np

from dvs_simulation.exact.compilation import jit

from .layout import DRIFT, ETA, FORCING, FREQUENCY, POLE, RATE, WEIGHT

_EPS = 2.220446049250313e-16
_TOUCH = 4.0 * _EPS


@jit
def multiply_dense(
    shape: np.ndarray, dense: np.ndarray, state: np.ndarray, row: int, i: int
) -> float:
    """Coordinate `i` of the block-diagonal matrix times ``state[row]``, for dense blocks."""
    j = 0
    while shape[4 + j] <= i:
        j += 1
    start = shape[3 + j]
    total = 0.0
    for l in range(shape[4 + j] - start):
        total += dense[j, i - start, l] * state[row, start + l]
    return total


@jit
def find_rates(
    shape: np.ndarray, modal: np.ndarray, dense: np.ndarray, state: np.ndarray, drive: float
) -> tuple[float, float, float]:
    """``rate = d eta / dt`` under the input `drive`; returns three derivatives of s."""
    first, second, third = 0.0, 0.0, 0.0
    p = shape[0]
    for j in range(p):
        pole = modal[POLE, j]
        rate = pole * state[ETA, j] + modal[FORCING, j] * drive + modal[DRIFT, j]
        state[RATE, j] = rate
        term = modal[WEIGHT, j] * rate
        first += term
        second += pole * term
        third += pole * pole * term
    first_dense = p + 2 * shape[1]
    for a in range(p, first_dense, 2):
        b = a + 1
        sigma, omega = modal[POLE, a], modal[FREQUENCY, a]
        x, y = state[ETA, a], state[ETA, b]
        x, y = (
            sigma * x + omega * y + modal[FORCING, a] * drive + modal[DRIFT, a],
            sigma * y - omega * x + modal[FORCING, b] * drive + modal[DRIFT, b],
        )
        state[RATE, a], state[RATE, b] = x, y
        first += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
        x, y = sigma * x + omega * y, sigma * y - omega * x
        second += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
        x, y = sigma * x + omega * y, sigma * y - omega * x
        third += modal[WEIGHT, a] * x + modal[WEIGHT, b] * y
    for i in range(first_dense, modal.shape[1]):
        rate = multiply_dense(shape, dense, state, ETA, i)
        rate += modal[FORCING, i] * drive + modal[DRIFT, i]
        state[RATE, i] = rate
        first += modal[WEIGHT, i] * rate
    for i in range(first_dense, modal.shape[1]):
        second += modal[WEIGHT, i] * multiply_dense(shape, dense, state, RATE, i)
    return first, second, third


@jit
def position(modal: np.ndarray, state: np.ndarray, offset: float) -> tuple[float, float]:
    """The scalar s and the distance within which it touches a threshold."""
    s = offset
    scale = abs(offset)
    for j in range(modal.shape[1]):
        term = modal[WEIGHT, j] * state[ETA, j]
        s += term
        scale += abs(term)
    return s, _TOUCH * scale
