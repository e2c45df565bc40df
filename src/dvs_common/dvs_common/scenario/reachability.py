"""What an input reaches: ranks of the staircase, and unstable modes that are left over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray

# Relative tolerance of ranks.
RANK_TOLERANCE = 1e-9
# Entries of B below this share of the largest one in their column are rounding.
_NOISE = 1e-14


def unreachable_unstable_mode(a: FloatArray, b: FloatArray) -> complex | None:
    """A mode of `a` in the closed right half plane that `b` does not reach, or None.

    The eigenvalues of what the staircase leaves over are looked at. A rank test at each eigenvalue
    of A (Hautus) would miss a mode out of reach in a Jordan chain: such eigenvalues come with
    errors of ``eps^(1/k)``. The pair (A', c) gives the unstable modes that c does not see.

    The answer does not depend on the units of the states, over twelve orders of magnitude. So a
    link between states that is only rounding has to be 0 in A.

    Parameters
    ----------
    a
        A, shape (n, n).
    b
        B, shape (n, m).
    """
    b = np.where(np.abs(b) > _NOISE * np.max(np.abs(b), axis=0, initial=0.0), b, 0.0)
    size = _reached_size(a, b)
    reached = size > 0
    aside = a[np.ix_(~reached, ~reached)]
    inside = a[np.ix_(reached, reached)] * size[reached] / size[reached, None]
    inputs = b[reached] / size[reached, None]
    rest = unreachable_basis(inside, inputs)
    scale = max(_norm(inside), float(np.max(np.abs(np.linalg.eigvals(a)), initial=0.0)))
    for block in (aside, rest.T @ inside @ rest):
        for mode in np.linalg.eigvals(block):
            if mode.real >= -RANK_TOLERANCE * scale:
                return complex(mode)
    return None


def unreachable_basis(a: FloatArray, b: FloatArray) -> FloatArray:
    """Orthonormal basis of what is orthogonal to the reachable subspace, shape (n, n - k).

    The reachable subspace grows from range(B) by A (staircase: Dooren, IEEE TAC 26(1), 1981).

    Parameters
    ----------
    a
        A, shape (n, n).
    b
        B, shape (n, m).
    """
    scale = max(_norm(a), 1e-300)
    basis = _orthonormal_basis(b)
    while 0 < basis.shape[1] < a.shape[0]:
        grown = _orthonormal_basis(np.hstack([basis, a @ basis / scale]))
        if grown.shape[1] == basis.shape[1]:
            break
        basis = grown
    left: FloatArray = np.linalg.svd(basis, full_matrices=True)[0]
    return left[:, basis.shape[1] :]


def has_full_column_rank(matrix: NDArray[np.inexact[Any]], *, scale: float | None = None) -> bool:
    """Whether no column is a sum of others, within `RANK_TOLERANCE`.

    Parameters
    ----------
    matrix
        Shape (m, n), real or complex.
    scale
        What the least singular value is compared with; the largest one by default.
    """
    if matrix.shape[0] < matrix.shape[1]:
        return False
    s = np.linalg.svd(matrix, compute_uv=False)
    if scale is None:
        scale = max(float(np.max(s, initial=0.0)), 1e-300)
    return bool(np.min(s, initial=math.inf) > RANK_TOLERANCE * scale)


def null_space_projector(matrix: FloatArray) -> FloatArray:
    """Orthogonal projector on the null space, shape (n, n).

    Parameters
    ----------
    matrix
        Shape (m, n).
    """
    _, s, vt = np.linalg.svd(matrix, full_matrices=True)
    null = vt[int(np.sum(s > RANK_TOLERANCE * max(1.0, float(s[0])))) :]
    return np.asarray(null.T @ null)


def _reached_size(a: FloatArray, b: FloatArray) -> FloatArray:
    """How far each state moves, ``d = (sigma I - |A|)^-1 |B| 1``; 0 where no input reaches.

    With ``sigma > rho(|A|)`` every term is positive, d scales with the units of the states, and
    ``|A|`` is at most sigma in the units d.
    """
    gains = np.abs(a)
    links = np.linalg.matrix_power((gains > 0).astype(np.float64), len(a)) if a.size else gains
    sigma = 2 * float(np.max(np.abs(np.linalg.eigvals(gains)))) if links.any() else 1.0
    columns = np.abs(b)
    drive = (columns / np.maximum(columns.max(axis=0, initial=0.0), 1e-300)).sum(axis=1)
    size = np.zeros(len(a))
    for _ in range(2 * len(a) + 60):
        size = (drive + gains @ size) / sigma
    return size


def _norm(matrix: FloatArray) -> float:
    return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0


def _orthonormal_basis(matrix: FloatArray) -> FloatArray:
    u, s, _ = np.linalg.svd(matrix, full_matrices=False)
    largest = float(np.max(s, initial=0.0))
    return np.asarray(u[:, : int(np.sum(s > RANK_TOLERANCE * max(largest, 1e-300)))])
