"""Stabilizing solutions of Riccati equations with a sign-indefinite quadratic term."""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from dvs_interfaces.model import FloatArray

_AXIS_TOLERANCE = 1e-11


def stabilizing_solution(a: FloatArray, s: FloatArray, q: FloatArray) -> FloatArray | None:
    """X with ``a'X + X a - X s X + q = 0`` and ``a - s X`` stable, or None where there is none.

    Stable invariant subspace of the Hamiltonian matrix by an ordered Schur form, after a scaling
    that evens out `s` and `q` (Laub 1979; Zhou, Doyle and Glover 1996, theorem 13.5).

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
    scale = math.sqrt(_size(q) / _size(s))
    hamiltonian = np.block([[a, -scale * s], [-q / scale, -a.T]])
    form, basis, stable = scipy.linalg.schur(hamiltonian, output='real', sort='lhp')
    modes = np.linalg.eigvals(form)
    if stable != n or np.any(np.abs(modes.real) <= _AXIS_TOLERANCE * np.abs(modes).max()):
        return None
    top, bottom = basis[:n, :n], basis[n:, :n]
    if np.linalg.cond(top) > 1e13:
        return None
    x = scale * np.linalg.solve(top.T, bottom.T).T
    return np.asarray((x + x.T) / 2)


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


def _size(matrix: FloatArray) -> float:
    return max(float(np.linalg.norm(matrix)), 1e-12)
