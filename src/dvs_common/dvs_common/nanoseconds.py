"""Time is counted in integer nanoseconds; seconds are for people and for formulas."""

from __future__ import annotations

from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray

NANOSECONDS = 1_000_000_000
"""Nanoseconds of a second."""


def as_nanoseconds(seconds: float) -> int:
    """Nearest whole number of nanoseconds.

    Parameters
    ----------
    seconds
        Time, s.
    """
    return round(seconds * NANOSECONDS)


@overload
def as_seconds(nanoseconds: int) -> float: ...


@overload
def as_seconds(nanoseconds: NDArray[np.integer]) -> FloatArray: ...


def as_seconds(nanoseconds: Any) -> Any:
    """Time in seconds: a double, or an array of doubles for an array.

    Parameters
    ----------
    nanoseconds
        Time, ns.
    """
    return nanoseconds * 1e-9
