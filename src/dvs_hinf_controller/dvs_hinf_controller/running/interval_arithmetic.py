"""Intervals of references as pairs of arrays, and the bounds that sensor and anchors give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import MessageError

# Beyond this a luminosity and what K makes of it are no longer numbers.
LARGEST_LOGARITHM = 300.0
# Ends of an interval that differ by rounding alone.
ROUNDING = 1e-9
# An interval this wide, M = 400 m, is no measurement any more.
UNKNOWN_WIDTH = 3.0

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorBounds:
    """Bounds that a sensor gives of its references at an instant.

    Parameters
    ----------
    event_threshold
        h.
    counts
        N, shape (r,), int64.
    signs
        Sign of every reference, shape (r,), int8.
    lower
        m: where |q| was at least at N = 0, shape (r,); 0 where the sensor gives none.
    upper
        M: where it was at most, shape (r,); infinite where the sensor gives none.
    age_s
        Time since the sensor's start, s.
    events
        Events of all pixels since then.
    """

    event_threshold: float
    counts: NDArray[np.int64]
    signs: NDArray[np.int8]
    lower: FloatArray
    upper: FloatArray
    age_s: float
    events: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cut:
    """What an absolute measurement did to the intervals.

    Parameters
    ----------
    confirmed
        Pixels whose interval had a part in common with the measured one, shape (r,).
    contradicted
        Pixels whose interval had none, shape (r,): a noise event, or a loss that was not reported.
    """

    confirmed: Bools
    contradicted: Bools


def common_part(
    known: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Common part of intervals, in the bits of the first where both agree.

    Where there is none, one of the two was wrong, and what holds both is right.

    Parameters
    ----------
    known
        Lower and upper ends, shape (r,) each.
    other
        Lower and upper ends, shape (r,) each.
    """
    (lower, upper), (other_lower, other_upper) = known, other
    low = np.where(other_lower > lower * (1 + ROUNDING), other_lower, lower)
    high = np.where(other_upper < upper * (1 - ROUNDING), other_upper, upper)
    none = low > high
    low = np.where(none, np.minimum(lower, other_lower), low)
    return low, np.where(none, np.maximum(upper, other_upper), high)


def half_widths(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """``1/2 ln(M/m)``, shape (r,); infinite where nothing is known.

    Parameters
    ----------
    lower
        m, shape (r,).
    upper
        M, shape (r,).
    """
    with np.errstate(divide='ignore'):
        return np.asarray(0.5 * (np.log(upper) - np.log(lower)))


def require_finite(logarithm: FloatArray) -> None:
    """Refuse counts that no luminosity explains: noise, or another camera's.

    Parameters
    ----------
    logarithm
        How far references have moved, in natural logarithms.

    Raises
    ------
    MessageError
        If one of them has moved out of the range of numbers.
    """
    largest = float(np.max(np.abs(logarithm), initial=0.0))
    if not largest < LARGEST_LOGARITHM:
        raise MessageError(
            f'a reference would be e^{largest:.6g} times what it was at first: '
            'the luminosity is not physically possible'
        )
