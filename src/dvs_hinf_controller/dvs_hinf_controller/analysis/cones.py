"""Upper bound of a norm over the unit sphere, by cutting the sphere into ever smaller cones."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray

Norm = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cones:
    """Cones that unit vectors span, shape (S, n, n): a row each; and the norm of each, (S, n)."""

    corners: FloatArray
    values: FloatArray

    @property
    def bounds(self) -> FloatArray:
        """What the norm does not exceed on the unit vectors of each cone, shape (S,).

        A convex function stays below the linear one that has its values at the corners. On the
        unit sphere that is at most the length of its gradient, and within the cone at most its
        largest value over the distance of the corners' hull from the origin.
        """
        gradients = np.linalg.solve(self.corners, self.values[:, :, None])[:, :, 0]
        widest = self._cosines.min(axis=(1, 2))
        distance = np.sqrt(widest + (1 - widest) / self.values.shape[1])
        steepest = np.linalg.norm(gradients, axis=1)
        return np.asarray(np.minimum(steepest, self.values.max(axis=1) / distance))

    @property
    def _cosines(self) -> FloatArray:
        """Between the corners of each cone, shape (S, n, n); none is negative."""
        return np.asarray(np.einsum('sik,sjk->sij', self.corners, self.corners))

    def chosen(self, which: NDArray[np.bool_]) -> _Cones:
        return _Cones(corners=self.corners[which], values=self.values[which])

    def halves(self, norm: Norm) -> _Cones:
        """Two cones for each, cut in the middle of its longest edge."""
        count, n = self.values.shape
        flat = self._cosines.reshape(count, -1)
        first, second = np.unravel_index(flat.argmin(axis=1), (n, n))
        each = np.arange(count)
        middle = self.corners[each, first] + self.corners[each, second]
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        # Neighbours share the edges that are cut.
        unique, where = np.unique(middle.round(12), axis=0, return_inverse=True)
        values = norm(unique.T)[where.ravel()]
        corners, found = np.tile(self.corners, (2, 1, 1)), np.tile(self.values, (2, 1))
        for half, corner in enumerate((first, second)):
            corners[half * count + each, corner] = middle
            found[half * count + each, corner] = values
        return _Cones(corners=corners, values=found)


def largest_on_sphere(norm: Norm, n: int, *, lower: float, rtol: float, most: int) -> float:
    """Upper bound of ``max norm(v)`` over the unit vectors v.

    Parameters
    ----------
    norm
        A norm (even, convex, of degree one) of every column, (n, k) to (k,).
    n
        Size of v, at least 2.
    lower
        A value that is attained.
    rtol
        Relative distance from the largest value that is known, at which a cone needs no cut.
    most
        Number of cones from which on none is cut any more.
    """
    signs = np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * (n - 1))))
    corners = signs[:, :, None] * np.eye(n)
    cones = _Cones(corners=corners, values=np.tile(norm(np.eye(n)), (len(signs), 1)))
    settled, best, tried = 0.0, max(lower, float(cones.values.max())), len(signs)
    while True:
        bounds = cones.bounds
        is_open = bounds > best * (1 + rtol)
        settled = max(settled, float(np.max(bounds[~is_open], initial=0.0)))
        tried += 2 * int(is_open.sum())
        if not is_open.any() or tried > most:
            return max(settled, best, float(bounds.max()))
        cones = cones.chosen(is_open).halves(norm)
        best = max(best, float(cones.values.max()))
