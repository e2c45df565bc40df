"""The unit vector over the states that makes an L1 norm largest, and bounds of that norm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.cones import largest_on_sphere

# Products at a time: as many as a cache holds.
_BLOCK = 32768
_MOST_IN_CONES = 4
_CONE_RTOL, _CONE_WORK = 2e-3, 2e9
_SECTORS = 32
_PLANE_RTOL = 1e-5
_ASCENT_STARTS = 12
_ASCENT_STEPS = 100
_ASCENT_WORK = 3e7
# Vectors beyond which only a part of them is taken for most steps.
_ASCENT_VECTORS = 4000
_POLISHED, _POLISH_STEPS = 3, 4
# Cosine from which on two directions count as one.
_ALIKE = 0.98
_RELAXATION_STEPS = 40
_RELAXATION_RTOL = 3e-4
_RELAXATION_WORK = 1e8
# Vectors whose squares are below all numbers have a length that is.
_LEAST_LENGTH = 1e-150


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightedVectors:
    """Vectors g and the weights with which ``|v'g|`` is summed.

    Parameters
    ----------
    values
        g, shape (N, n).
    weights
        Shape (N,).
    """

    values: FloatArray
    weights: FloatArray

    def integral(self, directions: FloatArray) -> FloatArray:
        """``sum weights |v'g|`` for every column v.

        Parameters
        ----------
        directions
            Shape (n, k).
        """
        columns = directions.shape[1]
        total, room = np.zeros(columns), np.empty((_rows(columns), columns))
        for part in parts_of(len(self.values), columns):
            values = self.values[part]
            products = np.matmul(values, directions, out=room[: len(values)])
            total += self.weights[part] @ np.abs(products, out=products)
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracket:
    """A lower and an upper bound.

    Parameters
    ----------
    lower
        Attained.
    upper
        Never exceeded.
    """

    lower: float
    upper: float


def largest_integral(kernel: WeightedVectors) -> Bracket:
    """Bracket of ``max_v sum weights |v'g|`` over unit vectors, a norm of v, hence convex.

    Parameters
    ----------
    kernel
        Vectors and weights.
    """
    n = kernel.values.shape[1]
    if n == 1:
        value = float(kernel.integral(np.ones((1, 1)))[0])
        return Bracket(lower=value, upper=value)
    if n == 2:
        return _largest_in_plane(kernel)
    return _bracket(kernel, steepest_direction(kernel), known=0.0)


def largest_bound(values: FloatArray, weights: FloatArray) -> float:
    """Upper bound of ``max_v sum weights |v'g|`` of the worst of some kernels that differ little.

    Parameters
    ----------
    values
        g of every kernel, shape (P, N, n).
    weights
        Of all of them alike, shape (N,).
    """
    n = values.shape[2]
    # With the length in place of |v'g|; a kernel that can't be the worst is left out.
    crude = lengths_of(values) @ weights
    best, v, density = 0.0, None, None
    for k in np.argsort(-crude):
        if crude[k] <= best:
            break
        kernel = WeightedVectors(values=values[k], weights=weights)
        if n <= 2:
            best = max(best, largest_integral(kernel).upper)
            continue
        v = steepest_direction(kernel) if v is None else _ascended(kernel, v[:, None], 1)[:, 0]
        if n <= _MOST_IN_CONES:
            best = max(best, _bracket(kernel, v, known=best).upper)
            continue
        relaxed = _relaxed_maximum(kernel, _mixed(np.outer(v, v) if density is None else density))
        best, density = max(best, relaxed.bound), relaxed.density
    return best


def _bracket(kernel: WeightedVectors, v: FloatArray, *, known: float) -> Bracket:
    """Bracket by a direction and by cones; not refined where the upper bound is within `known`."""
    n = len(v)
    lower = float(kernel.integral(v[:, None])[0])
    upper = math.inf
    if n <= _MOST_IN_CONES:
        enough = max(lower, known / (1 + _CONE_RTOL))
        most = int(_CONE_WORK / kernel.values.size)
        upper = largest_on_sphere(kernel.integral, n, lower=enough, rtol=_CONE_RTOL, most=most)
    if upper > max(lower * (1 + 2 * _CONE_RTOL), known):
        upper = min(upper, _relaxed_maximum(kernel, _mixed(np.outer(v, v))).bound)
    return Bracket(lower=lower, upper=upper)


def _largest_in_plane(kernel: WeightedVectors) -> Bracket:
    """Bracket by bisecting sectors: inside one of half-width a, at most its ends' / cos(a)."""

    def values(angles: FloatArray) -> FloatArray:
        return kernel.integral(np.array([np.cos(angles), np.sin(angles)]))

    angles = np.linspace(0, math.pi, _SECTORS + 1)
    ends = values(angles)
    low, high = np.column_stack([angles[:-1], ends[:-1]]), np.column_stack([angles[1:], ends[1:]])
    best, settled = float(ends.max()), 0.0
    while low.size:
        cap = np.maximum(low[:, 1], high[:, 1]) / np.cos((high[:, 0] - low[:, 0]) / 2)
        is_open = cap > best * (1 + _PLANE_RTOL)
        settled = max(settled, float(np.max(cap[~is_open], initial=0.0)))
        low, high = low[is_open], high[is_open]
        middle = (low[:, 0] + high[:, 0]) / 2
        centre = np.column_stack([middle, values(middle)])
        best = max(best, float(np.max(centre[:, 1], initial=0.0)))
        low, high = np.vstack([low, centre]), np.vstack([centre, high])
    return Bracket(lower=best, upper=max(settled, best))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Relaxed:
    bound: float
    density: FloatArray


def _mixed(density: FloatArray) -> FloatArray:
    """Density matrix near another, with some of every direction."""
    n = len(density)
    return np.asarray(0.9 * density + 0.1 * np.eye(n) / n)


def _relaxed_maximum(kernel: WeightedVectors, s: FloatArray) -> _Relaxed:
    """Upper bound of ``max_v sum w |v'g|``: by Cauchy and Schwarz.

    For any positive a, ``(sum w |v'g|)^2 <= (sum w a) v' (sum w g g' / a) v``. The best a is
    ``sqrt(g'S g)`` with S a density matrix, found by the multiplicative update of optimal
    experiment design.
    """
    n = len(s)
    used = np.any(kernel.values != 0, axis=1)
    values, weights = kernel.values[used], kernel.weights[used]
    bound = math.inf
    steps = int(_RELAXATION_WORK / (values.shape[0] * n * n))
    for _ in range(min(max(steps, 4), _RELAXATION_STEPS)):
        a = np.maximum(np.sqrt(np.einsum('ij,ij->i', values @ s, values)), _LEAST_LENGTH)
        moment = (values * (weights / a)[:, None]).T @ values
        found = math.sqrt(float(weights @ a) * np.linalg.eigvalsh(moment)[-1])
        if found > bound * (1 - _RELAXATION_RTOL):
            return _Relaxed(bound=min(found, bound), density=s)
        bound = found
        root = scipy.linalg.sqrtm(s).real
        s = root @ moment @ root
        s = s / np.trace(s) + 1e-12 * np.eye(n)
    return _Relaxed(bound=bound, density=s)


def _rows(columns: int) -> int:
    """How many rows a cache holds."""
    return max(_BLOCK // max(columns, 1), 1)


def parts_of(rows: int, columns: int) -> list[slice]:
    """Rows that a cache holds at a time.

    Parameters
    ----------
    rows
        How many there are.
    columns
        Numbers in each.
    """
    step = _rows(columns)
    return [slice(first, first + step) for first in range(0, rows, step)]


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Euclidean lengths along the last axis; `numpy.linalg.norm` is slow where that is short.

    Parameters
    ----------
    vectors
        Shape (..., n).
    """
    return np.asarray(np.sqrt(np.einsum('...j,...j->...', vectors, vectors)))


def steepest_direction(kernel: WeightedVectors) -> FloatArray:
    """Unit vector v with a (locally) largest ``integral |v'g|``, shape (n,).

    Parameters
    ----------
    kernel
        Vectors and weights.
    """
    return steep_directions(kernel)[:, 0]


def steep_directions(kernel: WeightedVectors) -> FloatArray:
    """Unit vectors with locally largest ``integral |v'g|``, the largest first, shape (n, k).

    Every step moves to the gradient's direction, which never lowers a convex function. Where the
    vectors are many, a part of them leads near, and the last steps are taken with all.

    Parameters
    ----------
    kernel
        Vectors and weights.
    """
    weighted = kernel.weights[:, None] * kernel.values
    longest = np.argsort(-lengths_of(weighted), kind='stable')[:_ASCENT_STARTS]
    starts = np.vstack([np.eye(kernel.values.shape[1]), weighted[longest]])
    lengths = np.linalg.norm(starts, axis=1)
    v = (starts[lengths > 0] / lengths[lengths > 0, None]).T
    if len(weighted) <= 2 * _ASCENT_VECTORS:
        return _distinct(kernel, _ascended(kernel, v, _ASCENT_STEPS))
    part = np.linspace(0, len(weighted) - 1, _ASCENT_VECTORS).astype(int)
    few = WeightedVectors(values=kernel.values[part], weights=kernel.weights[part])
    near = _distinct(few, _ascended(few, v, _ASCENT_STEPS))[:, :_POLISHED]
    return _distinct(kernel, _ascended(kernel, near, _POLISH_STEPS))


def _ascended(kernel: WeightedVectors, v: FloatArray, steps: int) -> FloatArray:
    weighted = kernel.weights[:, None] * kernel.values
    affordable = max(int(_ASCENT_WORK / (weighted.size * v.shape[1])), 4)
    for _ in range(min(steps, affordable)):
        gradient = weighted.T @ np.sign(kernel.values @ v)
        moved = gradient / np.maximum(np.linalg.norm(gradient, axis=0), 1e-300)
        if np.allclose(moved, v, rtol=0, atol=1e-12):
            break
        v = moved
    return v


def _distinct(kernel: WeightedVectors, v: FloatArray) -> FloatArray:
    """The directions with the largest integral first, without those close to one before."""
    v = v[:, np.argsort(-kernel.integral(v), kind='stable')]
    alike = np.tril(np.abs(v.T @ v) > _ALIKE, -1)
    return np.asarray(v[:, ~alike.any(axis=1)])
