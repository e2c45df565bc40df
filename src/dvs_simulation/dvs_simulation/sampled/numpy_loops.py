"""NumPy's own inner loops by address, for compiled code that must give NumPy's bits.

NumPy's vectorised logarithm, and the BLAS that it carries, round otherwise than a C library does.
Compiled code that calls the very same loops gives the very same bits.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Loop = NDArray[np.int64]


class Loops(NamedTuple):
    """Address and data of every loop that the sampled loop needs, int64, shape (2,) each."""

    log: Loop
    exp: Loop
    add: Loop
    expm1: Loop
    complex_expm1: Loop
    complex_multiply: Loop
    complex_divide: Loop
    matmul: Loop
    complex_matmul: Loop


class _UfuncHead(ctypes.Structure):
    """The first members of PyUFuncObject (numpy/ufuncobject.h), part of NumPy's stable ABI."""

    _fields_ = (
        ('reference_count', ctypes.c_ssize_t),
        ('type', ctypes.c_void_p),
        ('nin', ctypes.c_int),
        ('nout', ctypes.c_int),
        ('nargs', ctypes.c_int),
        ('identity', ctypes.c_int),
        ('functions', ctypes.POINTER(ctypes.c_void_p)),
        ('data', ctypes.POINTER(ctypes.c_void_p)),
        ('ntypes', ctypes.c_int),
        ('reserved', ctypes.c_int),
        ('name', ctypes.c_char_p),
    )


@cache
def numpy_loops() -> Loops | None:
    """All loops; None where this NumPy or Python does not have them where they are looked for."""
    try:
        return Loops(
            log=_loop(np.log, 'd->d'),
            exp=_loop(np.exp, 'd->d'),
            add=_loop(np.add, 'dd->d'),
            expm1=_loop(np.expm1, 'd->d'),
            complex_expm1=_loop(np.expm1, 'D->D'),
            complex_multiply=_loop(np.multiply, 'DD->D'),
            complex_divide=_loop(np.divide, 'DD->D'),
            matmul=_loop(np.matmul, 'dd->d'),
            complex_matmul=_loop(np.matmul, 'DD->D'),
        )
    except LookupError:
        return None


def _loop(ufunc: np.ufunc, types: str) -> Loop:
    head = _UfuncHead.from_address(id(ufunc))
    shape = (ufunc.nin, ufunc.nout, ufunc.nargs, ufunc.ntypes)
    if (head.nin, head.nout, head.nargs, head.ntypes) != shape or types not in ufunc.types:
        raise LookupError(ufunc.__name__)
    number = ufunc.types.index(types)
    if head.name != ufunc.__name__.encode() or not head.functions[number]:
        raise LookupError(ufunc.__name__)
    return np.array([head.functions[number], head.data[number] or 0], np.int64)
