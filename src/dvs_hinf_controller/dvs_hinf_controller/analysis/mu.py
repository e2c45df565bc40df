"""Structured singular value of the closed loop: a bound for all frequencies, and a witness."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.hinf_norm import axis_crossings
from dvs_hinf_controller.state_space import ComplexArray, StateSpace

_POINTS_PER_DECADE = 40
_ZOOMS = 3
_SCALE_LIMIT = 1e4
_MAX_STEPS = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstCase:
    """A perturbation of the smallest size that makes the loop singular.

    Parameters
    ----------
    frequency
        rad/s.
    sector
        Complex Delta_i, the same for every pixel.
    performance
        Full block from x to w, shape (n,), complex.
    """

    frequency: float
    sector: complex
    performance: ComplexArray

    @property
    def size(self) -> float:
        """``max(|sector|, ||performance||)``; mu is at least its inverse."""
        return max(abs(self.sector), float(np.linalg.norm(self.performance)))


@dataclass(frozen=True, slots=True, kw_only=True)
class MuBounds:
    """Bracket of ``mu = sup_w (|T(jw)| + ||G(jw)||)``.

    Parameters
    ----------
    lower
        Inverse size of `worst_case`.
    upper
        A value that no frequency exceeds, on or between grid points.
    worst_case
        The witness of `lower`; None where the loop does not respond at all.
    """

    lower: float
    upper: float
    worst_case: WorstCase | None


def mu_bounds(g: StateSpace, output_vector: FloatArray, *, rtol: float = 5e-4) -> MuBounds:
    """Bracket mu of the loop for one repeated sector block and a full performance block.

    ``[T, T; G, G]`` has rank one, so that the D-scaled norm
    ``sqrt(1 + d^2) sqrt(|T|^2 + ||G||^2 / d^2)`` attains mu at ``d^2 = ||G|| / |T|``
    (docs/theory.md, "Structured optimum"). The upper bound marches from w = 0 to infinity: a
    constant d proves the level up to the first frequency where its scaled norm crosses it, an
    eigenvalue of a Hamiltonian matrix, and the next d takes over there.

    Parameters
    ----------
    g
        G, stable, from the mean disturbance to x; see `state_response`.
    output_vector
        c, shape (n,).
    rtol
        Relative width of the bracket.

    Returns
    -------
    MuBounds
        Infinite if `g` is unstable.
    """
    if g.abscissa >= 0:
        return MuBounds(lower=math.inf, upper=math.inf, worst_case=None)
    frequency = _peak(g, output_vector)
    lower = float(mu_response(g, output_vector, np.array([frequency]))[0])
    if lower < np.finfo(float).tiny ** 0.25:
        return MuBounds(lower=0.0, upper=0.0, worst_case=None)
    frequency, lower, upper = _march(g, output_vector, frequency, lower, rtol)
    worst = _worst_case(g, output_vector, frequency)
    return MuBounds(lower=1 / worst.size, upper=upper, worst_case=worst)


def mu_response(g: StateSpace, output_vector: FloatArray, frequencies: FloatArray) -> FloatArray:
    """``|T(jw)| + ||G(jw)||`` at every frequency, shape (f,).

    Parameters
    ----------
    g
        G.
    output_vector
        c, shape (n,).
    frequencies
        w, shape (f,), rad/s.
    """
    response = g.response(frequencies)[:, :, 0]
    return np.asarray(np.abs(response @ output_vector) + np.linalg.norm(response, axis=1))


def log_grid(poles: ComplexArray, *, points_per_decade: int = _POINTS_PER_DECADE) -> FloatArray:
    """Zero, and a logarithmic grid two decades beyond the slowest and the fastest pole, rad/s.

    Parameters
    ----------
    poles
        Poles that set the range; those at zero are left out.
    points_per_decade
        Density.
    """
    magnitudes = np.abs(poles)[np.abs(poles) > 1e-12]
    low, high = (magnitudes.min(), magnitudes.max()) if magnitudes.size else (1.0, 1.0)
    count = int(points_per_decade * (np.log10(high / low) + 4)) + 1
    return np.concatenate([[0.0], np.geomspace(low / 100, high * 100, count)])


def _peak(g: StateSpace, c: FloatArray) -> float:
    grid = np.unique(np.concatenate([log_grid(g.poles()), np.abs(g.poles().imag)]))
    values = mu_response(g, c, grid)
    best = int(np.argmax(values))
    for _ in range(_ZOOMS):
        near = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
        grid = np.linspace(*near, 41)
        values = mu_response(g, c, grid)
        best = int(np.argmax(values))
    return float(grid[best])


def _march(
    g: StateSpace, c: FloatArray, frequency: float, lower: float, rtol: float
) -> tuple[float, float, float]:
    level, position = lower * (1 + rtol), 0.0
    for step in range(_MAX_STEPS):
        response = g.response(np.array([position]))[0, :, 0]
        t, norm = abs(complex(c @ response)), float(np.linalg.norm(response))
        if t + norm >= level * (1 - 1e-3 * rtol):
            if t + norm > lower:
                frequency, lower = position, t + norm
            level = max(level, t + norm) * (1 + rtol)
        crossings = axis_crossings(_scaled(g, c, t, norm), level)
        ahead = crossings[crossings > position * (1 + 1e-10) + 1e-14]
        if ahead.size == 0:
            return frequency, lower, level
        position = float(ahead[0])
        if step % 500 == 499:
            level *= 1.01
    return frequency, lower, math.inf


def _scaled(g: StateSpace, c: FloatArray, t: float, norm: float) -> StateSpace:
    """``sqrt(1 + d^2) [T; G / d]`` with the d that is best where ``|T| = t``, ``||G|| = norm``."""
    limit = _SCALE_LIMIT / float(np.linalg.norm(c))
    d = math.sqrt(norm / max(t, norm / limit**2)) if norm > 0 else 1.0
    rows = np.vstack([c[None, :], np.eye(c.size) / d])
    return StateSpace(
        a=g.a, b=g.b, c=math.sqrt(1 + d * d) * rows @ g.c, d=np.zeros((c.size + 1, 1))
    )


def _worst_case(g: StateSpace, c: FloatArray, frequency: float) -> WorstCase:
    response = g.response(np.array([frequency]))[0, :, 0]
    t, norm = complex(c @ response), float(np.linalg.norm(response))
    mu = abs(t) + norm
    phase = t.conjugate() / abs(t) if t else 1.0
    return WorstCase(
        frequency=frequency, sector=phase / mu, performance=response.conj() / (norm * mu)
    )
