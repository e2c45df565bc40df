"""Thresholds and periods in words, where they are none or any."""

from __future__ import annotations

import math


def threshold_words(h: float, digits: int = 5) -> str:
    """A certified threshold: `any`, `none` where no threshold is fine enough, or its value.

    Parameters
    ----------
    h
        Infinite for any; zero or negative for none.
    digits
        Significant digits.
    """
    if h == math.inf:
        return 'any'
    return f'{h:.{digits}g}' if h > 0 else 'none'


def finite_or_any(value: float, digits: int = 4) -> str:
    """A bound, or `any` where there is none.

    Parameters
    ----------
    value
        Infinite for any.
    digits
        Significant digits.
    """
    return f'{value:.{digits}g}' if math.isfinite(value) else 'any'
