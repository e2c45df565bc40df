"""The least gamma at which a controller exists: bisection, most of it by secants in few tests."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dvs_hinf_controller.synthesis.synthesis_error import Assumption

_FLOOR, _CEILING = 1e-8, 1e10
_MAX_BISECTIONS = 80
_MAX_SECANTS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class GammaTest:
    """What the Riccati equations give at one gamma.

    Parameters
    ----------
    gamma
        Tested level.
    failure
        The condition that fails, or None where a controller exists.
    spectral_radius
        ``rho(X Y) / gamma^2``; not a number where X or Y is absent.
    """

    gamma: float
    failure: Assumption | None
    spectral_radius: float


class GammaSearch:
    """Bisection on gamma.

    What secants in ``1 / (rho(X Y) / gamma^2)``, nearly a straight line near the least gamma, have
    found to be feasible, or not, is not tested again, nor what follows from it: above a feasible
    gamma all are, below one that is not none is. The result is that of the plain bisection.

    Parameters
    ----------
    test
        What the Riccati equations give at a gamma.
    rtol
        Relative accuracy.

    Attributes
    ----------
    tests
        Every gamma that was tried, in order.
    """

    def __init__(self, test: Callable[[float], GammaTest], *, rtol: float) -> None:
        self._test, self._rtol = test, rtol
        self._infeasible, self._feasible = 0.0, math.inf
        self.tests: list[GammaTest] = []

    def least(self, near: float | None = None) -> float | None:
        """Least feasible gamma of the bisection; None if there is none up to 1e10.

        Parameters
        ----------
        near
            Where it is expected; None for no idea.
        """
        if near is not None:
            for trial in (near * (1 + 2 * self._rtol), near * (1 - 2 * self._rtol)):
                self._is_feasible(trial)
        low, high = _FLOOR, 1.0
        while not self._is_feasible(high):
            low, high = high, 10 * high
            if high > _CEILING:
                return None
        while low == _FLOOR and high > _FLOOR:
            if not self._is_feasible(high / 10):
                low = high / 10
            else:
                high /= 10
        self._close_in(low, high)
        for _ in range(_MAX_BISECTIONS):
            if high <= low * (1 + self._rtol):
                break
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self._is_feasible(middle) else (middle, high)
        return high

    def _is_feasible(self, gamma: float) -> bool:
        if gamma <= self._infeasible:
            return False
        if gamma >= self._feasible:
            return True
        self.tests.append(self._test(gamma))
        if self.tests[-1].failure is None:
            self._feasible = gamma
            return True
        self._infeasible = gamma
        return False

    def _close_in(self, low: float, high: float) -> None:
        """Narrow what is open to a part of the tolerance."""
        margin = self._rtol / 8
        for _ in range(_MAX_SECANTS):
            low, high = max(low, self._infeasible), min(high, self._feasible)
            root = self._root()
            if root is None or not low < root < high:
                self._is_feasible(math.sqrt(low * high))
                continue
            if high <= root * (1 + 2 * margin) and low >= root * (1 - 2 * margin):
                break
            nearest = min(high / root, root / low)
            if nearest > 1 + 2 * margin:
                self._is_feasible(root)
            else:
                is_open_below = high <= root * (1 + 2 * margin)
                self._is_feasible(root * (1 - margin if is_open_below else 1 + margin))

    def _root(self) -> float | None:
        """Where the secant through the two nearest tests has a spectral radius of 1."""
        points = sorted(
            (
                (1 / one.spectral_radius, one.gamma)
                for one in self.tests
                if one.spectral_radius > 0
            ),
            key=lambda point: abs(math.log(point[0])),
        )[:2]
        if len(points) < 2 or points[0][0] == points[1][0]:
            return None
        (y, x), (y0, x0) = points
        return x + (1 - y) * (x0 - x) / (y0 - y)
