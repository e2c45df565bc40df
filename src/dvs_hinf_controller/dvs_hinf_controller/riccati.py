"""Stabilizing solutions of Riccati equations with a sign-indefinite quadratic term."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.linalg

from dvs_interfaces.model import FloatArray

_AXIS_TOLERANCE = 1e-11
_RESIDUAL_TOLERANCE = 1e-6
_NEGLIGIBLE_RESIDUAL = 1e-11
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
    scale = _symplectic_scale(np.block([[a, -s], [-q, -a.T]]))
    a, s, q = a * scale[:, None] / scale, s * np.outer(scale, scale), q / np.outer(scale, scale)
    hamiltonian = np.block([[a, -s], [-q, -a.T]])
    try:
        form, basis, stable = scipy.linalg.schur(hamiltonian, output='real', sort='lhp')
    except np.linalg.LinAlgError:  # eigenvalues on the axis change sides while being sorted
        return None
    modes = np.linalg.eigvals(form)
    if stable != n or np.any(np.abs(modes.real) <= _AXIS_TOLERANCE * np.abs(modes).max()):
        return None
    top, bottom = basis[:n, :n], basis[n:, :n]
    if np.linalg.cond(top) > 1e13:
        return None
    x = np.linalg.solve(top.T, bottom.T).T
    x = _refined(a, s, q, (x + x.T) / 2)
    if _residual(a, s, q, x) > _RESIDUAL_TOLERANCE:
        return None
    return np.asarray(x * np.outer(scale, scale), dtype=np.float64)


def _refined(a: FloatArray, s: FloatArray, q: FloatArray, x: FloatArray) -> FloatArray:
    """A few Newton steps where rounding has left a residual (Kleinman 1968)."""
    for _ in range(_NEWTON_STEPS):
        if _residual(a, s, q, x) < _NEGLIGIBLE_RESIDUAL:
            break
        closed = a - s @ x
        modes = np.linalg.eigvals(closed)
        if np.max(modes.real) > -_AXIS_TOLERANCE * np.max(np.abs(modes)):
            break
        with warnings.catch_warnings():  # nearly singular: the residual decides
            warnings.simplefilter('ignore', RuntimeWarning)
            x = scipy.linalg.solve_continuous_lyapunov(closed.T, -q - x @ s @ x)
        x = (x + x.T) / 2
    return x


def _residual(a: FloatArray, s: FloatArray, q: FloatArray, x: FloatArray) -> float:
    terms = (a.T @ x, x @ a, -x @ s @ x, q)
    size = sum(float(np.linalg.norm(term)) for term in terms)
    return float(np.linalg.norm(sum(terms))) / max(size, 1e-300)


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
    _, (raw, _) = scipy.linalg.matrix_balance(magnitudes, permute=False, separate=True)
    exponents = np.log2(raw)
    return np.asarray(2.0 ** np.round((exponents[n:] - exponents[:n]) / 2), dtype=np.float64)
