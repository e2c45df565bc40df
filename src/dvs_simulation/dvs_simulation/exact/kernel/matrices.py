"""``exp(M tau)`` and its integral for a real pole, a pair of poles and a small dense block."""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

_SERIES = 1e-3  # below this |pole * tau| five terms of the series are exact to rounding


@jit
def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Product of two small square matrices, summed in a fixed order."""
    k = right.shape[0]
    result = np.zeros((k, k))
    for i in range(k):
        for j in range(k):
            for l in range(k):
                result[i, j] += left[i, l] * right[l, j]
    return result


@jit
def dense_step(matrix: np.ndarray, k: int, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """``exp(M tau)`` and its integral over [0, tau]: Taylor series, then doubling."""
    largest = 0.0
    for i in range(k):
        total = 0.0
        for j in range(k):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    doublings = 0
    while largest * tau > 0.5:
        tau *= 0.5
        doublings += 1
    exponential = np.zeros((k, k))
    integral = np.zeros((k, k))
    term = np.zeros((k, k))
    for i in range(k):
        term[i, i] = 1.0
    for order in range(1, 18):
        exponential += term
        integral += term * (tau / order)
        term = product(matrix, term) * (tau / order)
    for _ in range(doublings):
        integral = integral + product(exponential, integral)
        exponential = product(exponential, exponential)
    return exponential, integral


@jit
def real_gain(pole: float, tau: float) -> tuple[float, float]:
    """``exp(pole tau)`` and its integral over [0, tau]."""
    z = pole * tau
    if abs(z) < _SERIES:
        series = 1.0 + z * (1.0 / 3.0) * (1.0 + z * 0.25 * (1.0 + z * 0.2))
        gain = tau * (1.0 + z * 0.5 * series)
        return 1.0 + pole * gain, gain
    if z < -1.0:
        factor = math.exp(z)
        return factor, (factor - 1.0) / pole
    growth = math.expm1(z)
    return 1.0 + growth, growth / pole


@jit
def pair_gain(decay: float, frequency: float, tau: float) -> tuple[float, float, float, float]:
    """``exp(pole tau)`` and its integral for ``pole = decay - i frequency``, as real numbers."""
    growth = math.expm1(decay * tau)
    angle = 0.5 * frequency * tau
    half = math.sin(angle)
    sine = 2.0 * half * math.cos(angle)
    versine = 2.0 * half * half
    real = (1.0 + growth) * (1.0 - versine)
    imag = -(1.0 + growth) * sine
    minus_one = growth * (1.0 - versine) - versine
    square = decay * decay + frequency * frequency
    return (
        real,
        imag,
        (minus_one * decay - imag * frequency) / square,
        (imag * decay + minus_one * frequency) / square,
    )
