"""Compiled pixels: what happens to the level of every pixel, in one pass, as in `level_stages`."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.kernel_cache import kernel


@kernel
def low_pass(levels: Any, before: Any, output: Any, advance: float, decay: float) -> None:
    """First-order low-pass with one corner for all pixels; see `level_stages.LowPass`.

    Parameters
    ----------
    levels
        Levels, overwritten by what the filter lets through where they are finite, shape (k,).
    before, output
        Last level and output of the filter, shape (k,); updated in place.
    advance
        Length of the interval in time constants.
    decay
        ``exp(-advance)``.
    """
    for k in range(levels.size):
        meaningful = np.isfinite(levels[k])
        now = levels[k] if meaningful else before[k]
        lag = (now - before[k]) / advance
        output[k] = now - lag + (output[k] - before[k] + lag) * decay
        before[k] = now
        levels[k] = output[k] if meaningful else levels[k]


@kernel
def leak(levels: Any, phase: Any, rates: Any, seconds: float, step: float) -> None:
    """References that leak; see `level_stages.Leak`.

    Parameters
    ----------
    levels
        Levels, shape (k,); updated in place.
    phase
        Events by which each pixel is ahead, shape (k,).
    rates
        Events a second of each, 1/s, shape (k,).
    seconds
        Time since the first sample, s.
    step
        Threshold as a change of the level.
    """
    for k in range(levels.size):
        levels[k] += step * (phase[k] + rates[k] * seconds)
