"""What an event does to its pixel: count, sign of the reference, next thresholds, estimate."""

from __future__ import annotations

import math

import numpy as np

from dvs_simulation.exact.compilation import jit

from .layout import (
    COUNT,
    ESTIMATE,
    OFFSET,
    REFERENCE,
    SIGN,
    SUM,
    SUM_LOW,
    WINDOW,
    WINDOW_COUNT,
    WINDOW_START,
)


@jit
def power_of(power: np.ndarray, log_step: float, exponent: int) -> float:
    """``b^(exponent h)``, from the table where it reaches."""
    half = power.size >> 1
    if -half <= exponent <= half:
        return float(power[exponent + half])
    return math.exp(exponent * log_step)


@jit
def add_twofold(high: float, low: float, value: float) -> tuple[float, float]:
    """Add `value` to the double-double number ``high + low``."""
    total = high + value
    shadow = total - high
    low += (high - (total - shadow)) + (value - shadow)
    high = total + low
    return high, low - (high - total)


@jit
def fire(
    pixel: np.ndarray,
    pixel_state: np.ndarray,
    power: np.ndarray,
    log_step: float,
    dead_band: float,
    clock: np.ndarray,
    i: int,
    direction: int,
) -> tuple[int, float, float]:
    """Let pixel `i` fire as s moves in `direction`.

    Returns the polarity, or 0 for the pair of events with which the sign of the reference turns,
    and the next thresholds in s above and below.
    """
    count = pixel_state[i, COUNT]
    sign = pixel_state[i, SIGN]
    reference = pixel[i, REFERENCE]
    estimate = pixel[i, ESTIMATE]
    before = sign * estimate * power_of(power, log_step, count)
    polarity = 1 if direction == sign else -1
    if polarity < 0 and reference * power_of(power, log_step, count - 1) < dead_band:
        polarity = 0
        sign = direction
        pixel_state[i, SIGN] = sign
    count += polarity
    pixel_state[i, COUNT] = count
    after = sign * estimate * power_of(power, log_step, count)
    high, low = add_twofold(clock[SUM], clock[SUM_LOW], -before)
    clock[SUM], clock[SUM_LOW] = add_twofold(high, low, after)
    outer = reference * power_of(power, log_step, count + 1)
    inner = reference * power_of(power, log_step, count - 1)
    if inner < dead_band:  # silent inside the band: next at its far edge
        inner = -dead_band
    if sign > 0:
        return polarity, outer - pixel[i, OFFSET], inner - pixel[i, OFFSET]
    return polarity, -inner - pixel[i, OFFSET], -outer - pixel[i, OFFSET]


@jit
def record(
    times: np.ndarray, codes: np.ndarray, k: int, time: float, i: int, polarity: int, sign: int
) -> int:
    """Append one event, or the pair that turns the sign; returns the number of events."""
    times[k] = time
    codes[k, 0] = i
    codes[k, 1] = polarity if polarity != 0 else -1
    codes[k, 2] = sign if polarity != 0 else -sign
    if polarity != 0:
        return 1
    times[k + 1] = time
    codes[k + 1, 0] = i
    codes[k + 1, 1] = 1
    codes[k + 1, 2] = sign
    return 2


@jit
def too_fast(
    pixel: np.ndarray, pixel_state: np.ndarray, i: int, time: float, event_rate: float
) -> bool:
    """Count an event of pixel `i`; True if a full window of events took too little time."""
    pixel_state[i, WINDOW_COUNT] += 1
    if pixel_state[i, WINDOW_COUNT] == 1:
        pixel[i, WINDOW_START] = time
    if pixel_state[i, WINDOW_COUNT] < WINDOW:
        return False
    pixel_state[i, WINDOW_COUNT] = 0
    return bool((time - pixel[i, WINDOW_START]) * event_rate < WINDOW - 1)
