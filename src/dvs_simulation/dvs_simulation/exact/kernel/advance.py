"""A step in closed form, with an enclosure of s on the whole of it.

Along a step every mode is either convex or concave, so that it deviates from its chord to one side
only, by at most ``min(|rise|, H^2 max|second derivative| / 8)``; summed over the modes this
encloses s(t).
"""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

from .layout import (
    ETA,
    FREQUENCY,
    LOG_NORM,
    MODULUS,
    NORM_0,
    NORM_1,
    NORM_2,
    PAIR_WEIGHT,
    POLE,
    RATE,
    WEIGHT,
)
from .matrices import dense_step, pair_gain, real_gain

Enclosure = tuple[float, float, float, float, float, float]


@jit
def advance_pairs(
    shape: np.ndarray, modal: np.ndarray, state: np.ndarray, tau: float, target: int
) -> Enclosure:
    """Part of `advance` for the pairs of complex poles."""
    rise, slope, above, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[1]):
        a = shape[0] + 2 * j
        b = a + 1
        modulus = modal[MODULUS, a]
        real, imag, gain_real, gain_imag = pair_gain(modal[POLE, a], modal[FREQUENCY, a], tau)
        first_a, first_b = state[RATE, a], state[RATE, b]
        change_a = gain_real * first_a - gain_imag * first_b
        change_b = gain_imag * first_a + gain_real * first_b
        last_a = real * first_a - imag * first_b
        last_b = imag * first_a + real * first_b
        state[target, a] = state[ETA, a] + change_a
        state[target, b] = state[ETA, b] + change_b
        state[target + 1, a] = last_a
        state[target + 1, b] = last_b
        first = modal[WEIGHT, a] * first_a + modal[WEIGHT, b] * first_b
        last = modal[WEIGHT, a] * last_a + modal[WEIGHT, b] * last_b
        rise += modal[WEIGHT, a] * change_a + modal[WEIGHT, b] * change_b
        slope += last
        size = modal[PAIR_WEIGHT, a] * math.sqrt(first_a * first_a + first_b * first_b)
        if modal[POLE, a] > 0.0:
            size *= math.exp(modal[POLE, a] * tau)
        above += min(modulus * eighth, 4.0 / modulus) * size
        bend = modulus * modulus * eighth * size
        largest += min(max(first, last) + bend, size)
        least += max(min(first, last) - bend, -size)
    return rise, slope, above, above, least, largest


@jit
def advance_dense(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
    target: int,
) -> Enclosure:
    """Part of `advance` for the dense blocks."""
    rise, slope, above, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[2]):
        start = shape[3 + j]
        k = shape[4 + j] - start
        exponential, integral = dense_step(dense[j], k, tau)
        first, last, size = 0.0, 0.0, 0.0
        for i in range(k):
            change, moved = 0.0, 0.0
            for l in range(k):
                change += integral[i, l] * state[RATE, start + l]
                moved += exponential[i, l] * state[RATE, start + l]
            state[target, start + i] = state[ETA, start + i] + change
            state[target + 1, start + i] = moved
            first += modal[WEIGHT, start + i] * state[RATE, start + i]
            last += modal[WEIGHT, start + i] * moved
            rise += modal[WEIGHT, start + i] * change
            size += state[RATE, start + i] * state[RATE, start + i]
        slope += last
        size = math.sqrt(size) * math.exp(max(0.0, dense_bound[j, LOG_NORM] * tau))
        above += size * min(dense_bound[j, NORM_1] * eighth, 2.0 * dense_bound[j, NORM_0] * tau)
        bend = dense_bound[j, NORM_2] * eighth * size
        size *= dense_bound[j, NORM_0]
        largest += min(max(first, last) + bend, size)
        least += max(min(first, last) - bend, -size)
    return rise, slope, above, above, least, largest


@jit
def advance(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tau: float,
    target: int,
) -> Enclosure:
    """State after `tau` into the rows `target` and `target + 1`, and the enclosure of s.

    Returns the rise of s, its slope at the end, how far s may lie above and below its chord, and
    the least and largest slope on the way.
    """
    rise, slope, above, below, least, largest = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    eighth = 0.125 * tau * tau
    for j in range(shape[0]):
        pole = modal[POLE, j]
        factor, gain = real_gain(pole, tau)
        rate = state[RATE, j]
        state[target, j] = state[ETA, j] + gain * rate
        state[target + 1, j] = factor * rate
        first = modal[WEIGHT, j] * rate
        last = factor * first
        change = gain * first
        rise += change
        slope += last
        largest += max(first, last)
        least += min(first, last)
        bend = min(abs(pole) * eighth * max(abs(first), abs(last)), abs(change))
        if pole * first > 0.0:
            below += bend
        else:
            above += bend
    if shape[1] > 0:
        part = advance_pairs(shape, modal, state, tau, target)
        rise += part[0]
        slope += part[1]
        above += part[2]
        below += part[3]
        least += part[4]
        largest += part[5]
    if shape[2] > 0:
        part = advance_dense(shape, modal, dense, dense_bound, state, tau, target)
        rise += part[0]
        slope += part[1]
        above += part[2]
        below += part[3]
        least += part[4]
        largest += part[5]
    return rise, slope, above, below, least, largest
