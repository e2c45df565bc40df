"""Stabilizing solutions of Riccati equations with a sign-indefinite quadratic term."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.state_space import lyapunov_solution

_AXIS_TOLERANCE = 1e-11
_RESIDUAL_TOLERANCE = 1e-6
_NEGLIGIBLE_RESIDUAL = 1e-8
_NEWTON_STEPS = 3


def stabilizing_solution(a: FloatArray, s: FloatArray, q: FloatArray) -> FloatArray | None:
    """X with ``a'X + X a - X s X + q = 0`` and ``a - s X`` stable, or None where there is none.

    Stable invariant subspace of the balanced Hamiltonian matrix by an ordered Schur form (Laub
    1979; Zhou, Doyle and Glover 1996, theorem 13.5). A solution that does not solve the equation,
    because double precision does not suffice, is none.

    Parameters
    ----------
    a
        Shape (n, n).
    s
        Symmetric, shape (n, n), of any sign.
    q
        Symmetric, shape (n, n).
    """
    n = a.shape[0]
    scale = _symplectic_scale(_hamiltonian(a, s, q))
    a, s, q = a * scale[:, None] / scale, s * np.outer(scale, scale), q / np.outer(scale, scale)
    hamiltonian = _hamiltonian(a, s, q)
    _, stable, real, imaginary, basis, _, info = lapack.dgees(_is_stable, hamiltonian, sort_t=1)
    if info != 0 or stable != n:  # info > 2n: modes on the axis change sides while being sorted
        return None
    if np.min(np.abs(real)) <= _AXIS_TOLERANCE * np.max(np.hypot(real, imaginary)):
        return None
    top, bottom = basis[:n, :n], basis[n:, :n]
    if np.linalg.cond(top) > 1e13:
        return None
    x = np.linalg.solve(top.T, bottom.T).T
    x, residual = _refined(a, s, q, (x + x.T) / 2)
    if residual > _RESIDUAL_TOLERANCE:
        return None
    return np.asarray(x * np.outer(scale, scale), dtype=np.float64)


def _is_stable(real: float, _: float) -> bool:
    return real < 0


def _refined(
    a: FloatArray, s: FloatArray, q: FloatArray, x: FloatArray
) -> tuple[FloatArray, float]:
    """A few Newton steps where rounding has left a residual (Kleinman 1968)."""
    residual = _residual(a, s, q, x)
    for _ in range(_NEWTON_STEPS):
        if residual < _NEGLIGIBLE_RESIDUAL:
            break
        closed = a - s @ x
        modes = np.linalg.eigvals(closed)
        if np.max(modes.real) > -_AXIS_TOLERANCE * np.max(np.abs(modes)):
            break
        step = lyapunov_solution(closed.T, -q - x @ s @ x)  # its residual decides
        step = (step + step.T) / 2
        improved = _residual(a, s, q, step)
        if not improved < residual:
            break
        x, residual = step, improved
    return x, residual


def _residual(a: FloatArray, s: FloatArray, q: FloatArray, x: FloatArray) -> float:
    """Relative residual of the equation."""
    linear = x @ a
    quadratic = x @ s @ x
    size = 2 * _frobenius(linear) + _frobenius(quadratic) + _frobenius(q)
    return _frobenius(linear + linear.T - quadratic + q) / max(size, 1e-300)


def _frobenius(matrix: FloatArray) -> float:
    return math.sqrt(float(np.vdot(matrix, matrix)))


def _hamiltonian(a: FloatArray, s: FloatArray, q: FloatArray) -> FloatArray:
    n = a.shape[0]
    matrix = np.empty((2 * n, 2 * n))
    matrix[:n, :n], matrix[:n, n:] = a, -s
    matrix[n:, :n], matrix[n:, n:] = -q, -a.T
    return matrix


def is_semidefinite(x: FloatArray, *, rtol: float = 1e-8) -> bool:
    """Whether the symmetric `x` is positive semidefinite up to rounding.

    Parameters
    ----------
    x
        Symmetric, shape (n, n).
    rtol
        Accepted negative part, relative to the largest eigenvalue.
    """
    eigenvalues = np.linalg.eigvalsh(x)
    return bool(eigenvalues[0] >= -rtol * max(float(np.abs(eigenvalues).max()), 1e-300))


def _symplectic_scale(hamiltonian: FloatArray) -> FloatArray:
    """Powers of two D for which ``diag(D, 1/D) H diag(1/D, D)`` is balanced (Benner 2001)."""
    n = hamiltonian.shape[0] // 2
    magnitudes = np.abs(hamiltonian)
    np.fill_diagonal(magnitudes, 0.0)
    exponents = np.log2(lapack.dgebal(magnitudes, scale=1, permute=0)[3])
    return np.asarray(2.0 ** np.round((exponents[n:] - exponents[:n]) / 2), dtype=np.float64)
