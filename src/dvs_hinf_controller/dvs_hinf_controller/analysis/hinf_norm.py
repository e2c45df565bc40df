"""H-infinity norm by the Hamiltonian test: shares nothing with the synthesis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import ComplexArray, StateSpace, balanced

_AXIS_TOLERANCE = 1e-8
_MAX_PASSES = 40
_REFINEMENTS = 4
_POINTS = 33


@dataclass(frozen=True, slots=True, kw_only=True)
class HinfNorm:
    """Bracket of ``sup_w sigma_max(G(jw))``.

    Parameters
    ----------
    lower
        A value that G attains, at `frequency`.
    upper
        A value that no frequency attains (Hamiltonian test); infinite if G is unstable.
    frequency
        Where `lower` is attained, rad/s.
    """

    lower: float
    upper: float
    frequency: float


def hinf_norm(system: StateSpace, *, rtol: float = 1e-7) -> HinfNorm:
    """H-infinity norm of a stable system (Bruinsma and Steinbuch 1990, two-step algorithm).

    Parameters
    ----------
    system
        G, any size.
    rtol
        Relative width of the bracket.

    Returns
    -------
    HinfNorm
        ``lower <= norm <= upper``, with ``upper <= (1 + rtol) lower`` unless G is zero. Rounding
        can hide crossings of a stiff G from the Hamiltonian test, so that the search starts from
        a refined peak and `upper` is never below a value that was attained.
    """
    system = balanced(system)
    if system.abscissa >= 0:
        return HinfNorm(lower=math.inf, upper=math.inf, frequency=math.nan)
    lower, frequency = _refined_peak(system)
    for _ in range(_MAX_PASSES):
        level = max(lower * (1 + rtol), np.finfo(float).tiny ** 0.5)
        crossings = axis_crossings(system, level)
        if crossings.size == 0:
            return HinfNorm(lower=lower, upper=level, frequency=frequency)
        ends = np.concatenate([[0.0], crossings])
        middles = np.concatenate([(ends[1:] + ends[:-1]) / 2, np.sqrt(ends[1:] * ends[:-1])])
        found, where = _best(system, np.concatenate([middles, crossings]))
        if found <= lower * (1 + 0.1 * rtol):
            return HinfNorm(lower=lower, upper=level, frequency=frequency)
        lower, frequency = found, where
    return HinfNorm(lower=lower, upper=math.inf, frequency=frequency)


def axis_crossings(system: StateSpace, level: float) -> FloatArray:
    """Frequencies w >= 0 at which a singular value of G(jw) equals `level`, sorted, rad/s.

    Imaginary eigenvalues of the Hamiltonian matrix (Zhou, Doyle and Glover 1996, lemma 4.7).

    Parameters
    ----------
    system
        G, stable.
    level
        Positive, above the largest singular value of G's feedthrough.
    """
    a, b, c, d = system.a, system.b / level, system.c, system.d / level
    r = np.eye(d.shape[1]) - d.T @ d
    s = np.eye(d.shape[0]) - d @ d.T
    if np.linalg.eigvalsh(r)[0] <= 0:
        return np.array([0.0])
    br = np.linalg.solve(r, b.T)
    drift = a + b @ np.linalg.solve(r, d.T @ c)
    quadratic, cost = b @ br, c.T @ np.linalg.solve(s, c)
    scale = math.sqrt(
        max(float(np.linalg.norm(cost)), 1e-300) / max(float(np.linalg.norm(quadratic)), 1e-300)
    )
    hamiltonian = np.block([[drift, quadratic * scale], [-cost / scale, -drift.T]])
    eigenvalues = np.linalg.eigvals(hamiltonian)
    near = np.abs(eigenvalues.real) <= _AXIS_TOLERANCE * np.maximum(
        np.abs(eigenvalues), 1e-6 * np.linalg.norm(system.a)
    )
    return np.unique(np.abs(eigenvalues[near].imag))


def _refined_peak(system: StateSpace) -> tuple[float, float]:
    """Largest value on a grid through every pole, refined around the best point."""
    poles: ComplexArray = system.poles()
    sizes = np.abs(poles[np.abs(poles) > 0])
    near = np.geomspace(0.5, 2, 9)
    grid = np.unique(np.concatenate([[0.0], np.outer(sizes, near).ravel(), np.abs(poles.imag)]))
    best, frequency = _best(system, grid)
    for _ in range(_REFINEMENTS):
        if not math.isfinite(frequency):
            break
        at = int(np.searchsorted(grid, frequency))
        grid = np.linspace(grid[max(at - 1, 0)], grid[min(at + 1, grid.size - 1)], _POINTS)
        found, where = _best(system, grid)
        if found < best:
            break
        best, frequency = found, where
    return best, frequency


def _best(system: StateSpace, frequencies: FloatArray) -> tuple[float, float]:
    gains = np.linalg.norm(system.response(frequencies), ord=2, axis=(1, 2))
    best = int(np.argmax(gains))
    feedthrough = float(np.linalg.norm(system.d, 2)) if system.d.size else 0.0
    if feedthrough > gains[best]:
        return feedthrough, math.inf
    return float(gains[best]), float(frequencies[best])
