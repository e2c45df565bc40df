"""What sensor and estimator share: a threshold as a step, and where references start."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError


def threshold_step(event_threshold: float, log_base: float) -> float:
    """Threshold as a change of the natural logarithm, ``h ln b``.

    Parameters
    ----------
    event_threshold
        h > 0, in logarithms to the base b.
    log_base
        b > 1.

    Raises
    ------
    ParameterError
        If h is not positive and finite or b does not exceed 1.
    """
    if not 0 < event_threshold < math.inf:
        raise ParameterError('event_threshold', event_threshold, 'must be > 0 and finite')
    if not 1 < log_base < math.inf:
        raise ParameterError('log_base', log_base, 'must be > 1 and finite')
    return event_threshold * math.log(log_base)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceBounds:
    """What is known of the trigger references at the start: ``m_i <= q_i(0) <= M_i`` (A1).

    Parameters
    ----------
    lower
        m, shape (r,), > 0.
    upper
        M, shape (r,), >= m.

    Raises
    ------
    ParameterError
        If a bound is not positive or the lower one exceeds the upper one; names the pixel.
    """

    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        """Check the order of the bounds and freeze the arrays."""
        for name in ('lower', 'upper'):
            array = finite_array(f'reference_{name}', getattr(self, name), ndim=1)
            object.__setattr__(self, name, array)
        if self.lower.shape != self.upper.shape:
            raise ParameterError(
                'reference_lower',
                self.lower.shape,
                f'must have as many entries as reference_upper ({self.upper.size})',
            )
        if (bad := np.flatnonzero(self.lower <= 0)).size:
            i = int(bad[0])
            raise ParameterError(
                'reference_lower', float(self.lower[i]), f'must be > 0 (pixel {i}; paper, A1)'
            )
        if (bad := np.flatnonzero(self.lower > self.upper)).size:
            i = int(bad[0])
            raise ParameterError(
                'reference_lower',
                float(self.lower[i]),
                f'must not exceed reference_upper = {self.upper[i]:.9g} (pixel {i}; paper, A1)',
            )

    @classmethod
    def around(cls, luminosity: ArrayLike, uncertainty: float) -> ReferenceBounds:
        """Bounds ``|y_i(0)| -+ dy`` around the first luminosity (paper, section IV).

        Parameters
        ----------
        luminosity
            First sample y(0), shape (r,).
        uncertainty
            dy >= 0, in the unit of luminosity.

        Raises
        ------
        ParameterError
            If dy is negative or as large as some ``|y_i(0)|``.
        """
        magnitude = np.abs(finite_array('luminosity', luminosity, ndim=1))
        if not 0 <= uncertainty < np.inf:
            raise ParameterError('reference_uncertainty', uncertainty, 'must be >= 0 and finite')
        if (bad := np.flatnonzero(magnitude <= uncertainty)).size:
            i = int(bad[0])
            raise ParameterError(
                'reference_uncertainty',
                uncertainty,
                f'must be less than the first luminosity of every pixel; pixel {i} starts at '
                f'{magnitude[i]:.9g}, so that m_i would not be positive (paper, A1)',
            )
        return cls(lower=magnitude - uncertainty, upper=magnitude + uncertainty)
