"""The largest error of the tail of a run, attained and bounded, and its integral."""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

from .advance import advance
from .layout import (
    ERROR,
    ERROR_SIZE,
    ETA,
    INTEGRAL,
    LOG_NORM,
    MODULUS,
    NEW_ETA,
    PEAK,
    PEAK_BOUND,
    POLE,
    RATE,
    TIME,
)

# Steps that may hold a peak of the error are halved until its bound has only this room left.
_WATCH_ROOM = 1.002
_SHORTEST_WATCH = 2.0**-24


@jit
def error_norm(error_basis: np.ndarray, state: np.ndarray, row: int) -> float:
    """``||x - x_d||``."""
    total = 0.0
    for i in range(error_basis.shape[0]):
        entry = 0.0
        for j in range(error_basis.shape[1]):
            entry += error_basis[i, j] * state[row, j]
        total += entry * entry
    return math.sqrt(total)


@jit
def error_spread(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
) -> float:
    """How far x may leave its chord within a step."""
    spread = 0.0
    eighth = 0.125 * tau * tau
    p = shape[0]
    for j in range(p):
        largest = max(abs(state[RATE, j]), abs(state[NEW_ETA + 1, j]))
        bend = min(abs(modal[POLE, j]) * eighth * largest, abs(state[NEW_ETA, j] - state[ETA, j]))
        spread += modal[ERROR_SIZE, j] * bend
    for a in range(p, p + 2 * shape[1], 2):
        size = math.hypot(state[RATE, a], state[RATE, a + 1])
        size *= math.exp(max(0.0, modal[POLE, a] * tau))
        bend = min(modal[MODULUS, a] * eighth, 4.0 / modal[MODULUS, a]) * size
        spread += bend * (modal[ERROR_SIZE, a] + modal[ERROR_SIZE, a + 1])
    for j in range(shape[2]):
        size, norm, columns = 0.0, 0.0, 0.0
        start = shape[3 + j]
        k = shape[4 + j] - start
        for i in range(k):
            size += state[RATE, start + i] ** 2
            columns += modal[ERROR_SIZE, start + i] ** 2
            for l in range(k):
                norm += dense[j, i, l] ** 2
        size = math.sqrt(size) * math.exp(max(0.0, dense_bound[j, LOG_NORM] * tau))
        spread += math.sqrt(columns) * size * min(math.sqrt(norm) * eighth, 2.0 * tau)
    return spread


@jit
def watch_error(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    error_basis: np.ndarray,
    state: np.ndarray,
    clock: np.ndarray,
    tau: float,
    tail_start: float,
) -> float:
    """Largest error of the tail, attained and bounded, and its integral.

    Returns the step, shortened where it may hold a peak that its ends do not show.
    """
    before = clock[ERROR]
    if before < 0.0:
        before = error_norm(error_basis, state, ETA)
    shortest = tau * _SHORTEST_WATCH
    while True:
        after = error_norm(error_basis, state, NEW_ETA)
        largest = max(before, after)
        bound = largest + error_spread(shape, modal, dense, dense_bound, state, tau)
        if bound <= max(clock[PEAK], largest) * _WATCH_ROOM or tau <= shortest:
            break
        tau *= 0.5
        advance(shape, modal, dense, dense_bound, state, tau, NEW_ETA)
    start = clock[TIME]
    clock[ERROR] = after
    if start >= tail_start:
        clock[PEAK] = max(clock[PEAK], before)
    watched = start + tau - max(start, tail_start)
    if watched > 0.0:
        clock[PEAK] = max(clock[PEAK], after)
        clock[PEAK_BOUND] = max(clock[PEAK_BOUND], bound)
        clock[INTEGRAL] += 0.5 * (before + after) * watched
    return tau
