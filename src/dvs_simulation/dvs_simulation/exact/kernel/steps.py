"""The longest step that is proven: up to the next threshold, or free of any.

Where the enclosure of `advance` touches a threshold, the step is halved, or, where the slope has a
proven sign, the one crossing is found by safeguarded Newton steps.
"""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

from .advance import advance
from .layout import EVALUATIONS, NEW_ETA

_NEWTON_STEPS = 60


@jit
def guess_step(
    first: float, second: float, third: float, rise: float, fall: float, last: float
) -> float:
    """Time at which s reaches a threshold, from three derivatives, or twice the last step."""
    if first < 0.0:
        first, second, third = -first, -second, -third
        rise, fall = fall, rise
    root = first * first + 2.0 * second * rise
    if root < 0.0:
        root = first * first - 2.0 * second * fall
        return max(2.0 * last, (first + math.sqrt(root)) / -second)
    root = math.sqrt(root)
    if first + root <= 0.0:
        return 2.0 * last
    tau = 2.0 * rise / (first + root)
    # One Newton step on the cubic; `root` is the slope of the parabola at its crossing.
    correction = third * tau * tau * tau / 6.0
    slope = root + 0.5 * third * tau * tau
    if slope > 0.5 * root and abs(correction) < 0.25 * tau * slope:
        tau -= correction / slope
    return tau


@jit
def find_crossing(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tally: np.ndarray,
    goal: float,
    touch: float,
    high: float,
    rise: float,
    slope: float,
) -> float:
    """The one instant in (0, high] at which s has risen by `goal`; the slope keeps its sign.

    `rise` and `slope` are those at `high`; the new state ends at the crossing.
    """
    low, top, tau = 0.0, high, high
    for _ in range(_NEWTON_STEPS):
        miss = rise - goal
        if abs(miss) <= touch:
            return tau
        if (miss > 0.0) == (goal > 0.0):
            top = tau
        else:
            low = tau
        tau = tau - miss / slope if slope != 0.0 else low
        if not low < tau < top:
            tau = 0.5 * (low + top)
        if tau <= low or tau >= top:
            break
        rise, slope, _, _, _, _ = advance(shape, modal, dense, dense_bound, state, tau, NEW_ETA)
        tally[EVALUATIONS] += 1
    advance(shape, modal, dense, dense_bound, state, top, NEW_ETA)
    return top


@jit
def find_step(
    shape: np.ndarray,
    modal: np.ndarray,
    dense: np.ndarray,
    dense_bound: np.ndarray,
    state: np.ndarray,
    tally: np.ndarray,
    rise_to: float,
    fall_to: float,
    touch: float,
    tau: float,
) -> float:
    """Longest proven step of at most `tau`: up to the next crossing, or free of crossings.

    `rise_to` and `fall_to` are the distances to the nearest thresholds above and below.
    """
    while True:
        rise, slope, above, below, least, largest = advance(
            shape, modal, dense, dense_bound, state, tau, NEW_ETA
        )
        tally[EVALUATIONS] += 1
        top, bottom = max(rise, 0.0), min(rise, 0.0)
        if least < 0.0 < largest:
            top += above
            bottom -= below
        if top <= rise_to and bottom >= -fall_to:
            return tau
        up = rise >= rise_to - touch and (
            least >= 0.0 or (top <= rise + touch and bottom > -fall_to)
        )
        down = rise <= touch - fall_to and (
            largest <= 0.0 or (bottom >= rise - touch and top < rise_to)
        )
        if up or down:
            goal = rise_to if up else -fall_to
            return find_crossing(
                shape, modal, dense, dense_bound, state, tally, goal, touch, tau, rise, slope
            )
        tau *= 0.5
