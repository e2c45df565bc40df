"""Block-diagonal form of a system matrix: safe for defective, clustered and stiff spectra.

Eigenvectors alone fail on defective matrices. Here the eigenvalues stay together in one block as
long as separating them would need a badly conditioned change of basis (Bavely and Stewart, "An
algorithm for computing reducing subspaces by block diagonalization", SIAM J. Numer. Anal. 16,
1979). The result is then refined in extended precision, since the rounding of a Schur form is
relative to the *largest* pole: beside one at -1e6, a pole at -2 would keep only ten digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError

# Largest entry accepted in the change of basis that splits two blocks: it costs the state that
# factor in precision, so 1e4 leaves twelve digits.
SPLIT_BOUND = 1e4

_REFINEMENTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalForm:
    """``F = V blkdiag(...) W`` with ``W = V^-1``, in the order real poles, pairs, dense blocks.

    Parameters
    ----------
    real_poles
        Poles of the 1 x 1 blocks, shape (p,), 1/s.
    pair_decay
        sigma of the 2 x 2 blocks ``[[sigma, omega], [-omega, sigma]]``, shape (q,), 1/s.
    pair_frequency
        omega > 0 of the 2 x 2 blocks, shape (q,), rad/s.
    dense_blocks
        Blocks of poles too close to each other to be split, each (k, k), 1/s.
    basis
        V, shape (N, N).
    inverse
        W, shape (N, N), in extended precision.
    extended_basis
        V before it was rounded to float64.
    """

    real_poles: FloatArray
    pair_decay: FloatArray
    pair_frequency: FloatArray
    dense_blocks: tuple[FloatArray, ...]
    basis: FloatArray
    inverse: np.ndarray
    extended_basis: np.ndarray

    def to_modal(self, vector: FloatArray) -> FloatArray:
        """Coordinates ``W vector``, rounded once.

        Parameters
        ----------
        vector
            State or input vector, shape (N,).
        """
        return np.asarray(self.inverse @ vector.astype(np.longdouble), dtype=np.float64)

    def output(self, row: FloatArray) -> FloatArray:
        """Weights ``row V`` of the modal coordinates in an output, rounded once.

        Parameters
        ----------
        row
            Output row or rows, shape (N,) or (p, N).
        """
        return np.asarray(row.astype(np.longdouble) @ self.extended_basis, dtype=np.float64)


def modal_form(matrix: FloatArray, *, split_bound: float = SPLIT_BOUND) -> ModalForm:
    """Block-diagonal form of a real square matrix.

    Parameters
    ----------
    matrix
        F, shape (N, N), N >= 1.
    split_bound
        Largest entry of the transformation that separates two blocks; a smaller bound keeps more
        poles together.

    Raises
    ------
    ParameterError
        If `matrix` is not square or not finite.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise ParameterError('matrix', matrix.shape, 'must be square and not empty')
    if not np.isfinite(matrix).all():
        raise ParameterError('matrix', matrix.tolist(), 'must be finite')
    data = np.ascontiguousarray(matrix, dtype=np.float64).tobytes()
    return _cached_form(data, len(matrix), split_bound)


@lru_cache(maxsize=64)
def _cached_form(data: bytes, size: int, split_bound: float) -> ModalForm:
    """One decomposition for all runs of one loop, whatever their thresholds and initial states."""
    matrix = np.frombuffer(data).reshape(size, size)
    balanced, scaling = scipy.linalg.matrix_balance(matrix, permute=False)
    triangular, rotation = scipy.linalg.schur(balanced, output='real')
    sizes, triangular, similarity = _block_diagonalize(triangular, split_bound)
    basis = scaling @ rotation @ similarity
    return _classify(*_refine(matrix, basis, sizes), sizes)


def _block_diagonalize(
    triangular: FloatArray, split_bound: float
) -> tuple[list[int], FloatArray, FloatArray]:
    """Sizes of the blocks, the block-diagonal matrix and the change of basis that yields it."""
    t = np.array(triangular)
    n = t.shape[0]
    total = np.eye(n)
    sizes: list[int] = []
    start = 0
    while start < n:
        size = _diagonal_block_size(t, start)
        while start + size < n:
            end = start + size
            coupling = _splitter(t[start:end, start:end], t[end:, end:], t[start:end, end:])
            if coupling is not None and np.max(np.abs(coupling)) <= split_bound:
                total[:, end:] += total[:, start:end] @ coupling
                t[start:end, end:] = 0.0
                break
            t, swap, grown = _absorb_nearest(t, start, size)
            total = total @ swap
            size = grown
        sizes.append(size)
        start += size
    return sizes, t, total


def _diagonal_block_size(t: FloatArray, index: int) -> int:
    return 2 if index + 1 < t.shape[0] and t[index + 1, index] != 0.0 else 1


def _splitter(first: FloatArray, second: FloatArray, coupling: FloatArray) -> FloatArray | None:
    """X with ``first X - X second = -coupling``; None if the spectra touch."""
    if not coupling.any():
        return np.zeros_like(coupling)
    trsyl: Any = scipy.linalg.lapack.dtrsyl
    solution, scale, info = trsyl(first, second, -coupling, isgn=-1)
    if info != 0 or scale == 0.0 or not np.isfinite(solution).all():
        return None
    return np.asarray(solution) / float(scale)


def _absorb_nearest(t: FloatArray, start: int, size: int) -> tuple[FloatArray, FloatArray, int]:
    """Move the eigenvalue nearest to the block at `start` next to it and take it in."""
    trexc: Any = scipy.linalg.lapack.dtrexc
    end = start + size
    centre = np.trace(t[start:end, start:end]) / size
    best, distance, index = end, np.inf, end
    while index < t.shape[0]:
        width = _diagonal_block_size(t, index)
        corner = t[index : index + width, index : index + width]
        gap = float(np.min(np.abs(np.linalg.eigvals(corner) - centre)))
        if gap < distance:
            best, distance = index, gap
        index += width
    width = _diagonal_block_size(t, best)
    swap = np.eye(t.shape[0])
    if best != end:
        t, swap, info = trexc(t, swap, best + 1, end + 1)
        if info != 0:  # LAPACK found the two too close to swap: take in all that lies between
            return np.asarray(t), np.asarray(swap), best + width - start
    return np.asarray(t), np.asarray(swap), size + _diagonal_block_size(np.asarray(t), end)


def _refine(
    matrix: FloatArray, basis: FloatArray, sizes: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """V, W and ``W F V`` with V corrected in extended precision until off-blocks vanish."""
    f = matrix.astype(np.longdouble)
    v = _normalized(basis.astype(np.longdouble))
    w = _inverse(v)
    edges = np.concatenate([[0], np.cumsum(sizes)])
    for _ in range(_REFINEMENTS):
        v = _normalized(v + v @ _correction(w @ f @ v, edges))
        v = _canonical_pairs(v, f, edges)
        w = _inverse(v)
    return v, w, w @ f @ v


def _correction(m: np.ndarray, edges: np.ndarray) -> FloatArray:
    """X such that ``(I + X)^-1 m (I + X)`` is block-diagonal to first order."""
    poles = np.diag(m)
    gap = (poles[:, None] - poles).astype(np.float64)
    single = np.repeat(np.diff(edges) == 1, np.diff(edges))
    coupling = m.astype(np.float64)
    usable = np.outer(single, single) & (np.abs(gap) > np.abs(coupling))
    result = np.divide(-coupling, gap, out=np.zeros_like(gap), where=usable)
    for a, b in pairwise(edges):
        for c, d in pairwise(edges):
            if a != c and (b - a > 1 or d - c > 1):
                result[a:b, c:d] = _small_splitter(m[a:b, a:b], m[c:d, c:d], m[a:b, c:d])
    return result


def _small_splitter(first: np.ndarray, second: np.ndarray, coupling: np.ndarray) -> FloatArray:
    """X with ``first X - X second = -coupling`` for a coupling of the size of rounding errors."""
    zero = np.zeros(coupling.shape)
    if not coupling.any():
        return zero
    a, b, c = (block.astype(np.float64) for block in (first, second, coupling))
    operator = np.kron(a, np.eye(len(b))) - np.kron(np.eye(len(a)), b.T)
    if np.linalg.svd(operator, compute_uv=False)[-1] <= np.max(np.abs(c)):
        return zero  # equal poles that were never coupled
    return np.asarray(np.linalg.solve(operator, -c.ravel())).reshape(c.shape)


def _normalized(v: np.ndarray) -> np.ndarray:
    return np.asarray(v / np.sqrt(np.sum(v * v, axis=0)))


def _inverse(v: np.ndarray) -> np.ndarray:
    """Inverse in extended precision: Newton steps from the float64 inverse."""
    w = np.linalg.inv(v.astype(float)).astype(np.longdouble)
    identity = np.eye(len(v), dtype=np.longdouble)
    for _ in range(3):
        w = w + w @ (identity - v @ w)
    return w


def _canonical_pairs(v: np.ndarray, f: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Turn every 2 x 2 block with complex poles into ``[[sigma, omega], [-omega, sigma]]``."""
    if np.all(np.diff(edges) != 2):
        return v
    m = _inverse(v) @ f @ v
    v = v.copy()
    for a, b in pairwise(edges):
        if b - a == 2 and (frequency := _frequency(m[a:b, a:b])) > 0:
            corner = m[a:b, a:b]
            # Real and imaginary part of the eigenvector (m12, lambda - m11).
            real = corner[0, 1] * v[:, a] + (corner[1, 1] - corner[0, 0]) / 2 * v[:, a + 1]
            imag = frequency * v[:, a + 1]
            size = np.sqrt(np.sum(real * real) + np.sum(imag * imag))
            v[:, a], v[:, a + 1] = real / size, imag / size
    return v


def _frequency(corner: np.ndarray) -> Any:
    """Imaginary part of the poles of a 2 x 2 matrix; 0 if they are real or nearly defective."""
    square = -((corner[0, 0] - corner[1, 1]) ** 2) / 4 - corner[0, 1] * corner[1, 0]
    frequency = np.sqrt(max(square, np.longdouble(0)))
    largest = max(abs(corner[0, 1]), abs(corner[1, 0]))
    return frequency if frequency * SPLIT_BOUND > largest else np.longdouble(0)


def _classify(v: np.ndarray, w: np.ndarray, m: np.ndarray, sizes: list[int]) -> ModalForm:
    """Sort the blocks by kind: real poles, pairs, dense."""
    edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    real: list[int] = []
    pairs: list[int] = []
    dense: list[tuple[int, int]] = []
    for a, size in zip(edges[:-1], sizes, strict=True):
        if size == 1:
            real.append(a)
        elif size == 2 and _frequency(m[a : a + 2, a : a + 2]) > 0:
            pairs.append(a)
        else:
            dense.append((a, a + size))
    order = (
        real + [k for a in pairs for k in (a, a + 1)] + [k for a, b in dense for k in range(a, b)]
    )
    return ModalForm(
        real_poles=np.array([float(m[a, a]) for a in real]),
        pair_decay=np.array([float((m[a, a] + m[a + 1, a + 1]) / 2) for a in pairs]),
        pair_frequency=np.array([float(_frequency(m[a : a + 2, a : a + 2])) for a in pairs]),
        dense_blocks=tuple(np.ascontiguousarray(m[a:b, a:b].astype(float)) for a, b in dense),
        basis=np.ascontiguousarray(v[:, order].astype(float)),
        inverse=np.ascontiguousarray(w[order]),
        extended_basis=np.ascontiguousarray(v[:, order]),
    )
