"""The largest level of a monotone condition, in few evaluations of what it costs."""

from __future__ import annotations

import math
from collections.abc import Callable

_MOST = 18.0
_RTOL = 1e-10
_FIRST = 1e-3
_MOST_STEPS = 100


def largest_level(excess: Callable[[float], float], *, low: float) -> float:
    """Largest level in [low, 18] with ``excess <= 1``, from below, to a relative 1e-10.

    A loop with the sector ``delta = tanh(level - low)`` stays within ``N_G delta D /
    (1 - delta N_T)``, so that ``1/excess`` is affine in ``1/delta``, or nearly so: secants in
    these find the level at once, and halving the bracket serves where they don't.

    Parameters
    ----------
    excess
        What is held over what is allowed; grows with the level, may be 0 or infinite.
    low
        Least level.

    Returns
    -------
    float
        Minus infinity if there is none, infinity if every level will do.
    """
    if not excess(low) <= 1:
        return -math.inf
    if excess(_MOST) <= 1:
        return math.inf
    inside, outside = 0.0, _MOST - low
    known: list[tuple[float, float]] = []
    trial, width = _FIRST, math.inf
    for _ in range(_MOST_STEPS):
        found = excess(low + trial)
        if found <= 1:
            inside = trial
        else:
            outside = trial
        width = outside - inside
        if width <= _RTOL * outside:
            break
        if 0 < found < math.inf:
            known = [*known[-1:], (1 / math.tanh(trial), 1 / found)]
        trial = _next(known, inside, outside)
    return low + inside


def _next(known: list[tuple[float, float]], inside: float, outside: float) -> float:
    """Where the secant meets 1, or a hair beyond it on the side that is still open."""
    if known:
        (x, y), (x0, y0) = known[-1], known[0] if len(known) > 1 else (0.0, 0.0)
        slope = (y - y0) / (x - x0) if x != x0 else math.nan
        inverse = x + (1 - y) / slope if slope > 0 else math.nan
        if inverse > 1:
            root = math.atanh(1 / inverse)
            for trial in (root * (1 - 0.4 * _RTOL), root * (1 + 0.4 * _RTOL)):
                if inside < trial < outside:
                    return trial
    return math.sqrt(inside * outside) if inside > 0 else outside / 64
