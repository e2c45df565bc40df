"""Arrays of doubles, the one numeric type of the suite, and how foreign numbers become one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvs_common.errors import ParameterError

FloatArray = NDArray[np.float64]
# Numbers up to which Python's floats are cheaper than arrays.
FEW_FLOATS = 32


def finite_array(name: str, value: ArrayLike, *, ndim: int) -> FloatArray:
    """Read-only float64 copy of `value` with `ndim` axes, all of it finite.

    Parameters
    ----------
    name
        Name that an error message uses.
    value
        Anything that NumPy turns into an array of numbers.
    ndim
        Number of axes that the array must have.

    Raises
    ------
    ParameterError
        If `value` is not numeric, has another number of axes, or holds NaN or infinity.
    """
    try:
        array = np.array(value, dtype=np.float64, copy=True, order='C')
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(name, value, 'must be an array of numbers') from None
    if array.ndim != ndim:
        raise ParameterError(name, value, f'must have {ndim} axes, has {array.ndim}')
    if not np.isfinite(array).all():
        raise ParameterError(name, value, 'must be finite')
    array.setflags(write=False)
    return array
