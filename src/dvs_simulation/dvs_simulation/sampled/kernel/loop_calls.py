"""Calls of NumPy's inner loops from compiled code."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba.core import cgutils
from numba.extending import intrinsic

from dvs_common.kernel_cache import kernel

# Places in a call's scratch array: addresses of the arguments, dimensions, steps.
ir: Any = cgutils.ir  # type: ignore[attr-defined]
_DIMENSIONS, _STEPS = 4, 8
SCRATCH_SIZE = 20
_DOUBLE, _COMPLEX = 8, 16


def _typed_call(
    typing: Any, function: Any, arguments: Any, dimensions: Any, steps: Any, data: Any
) -> Any:
    """Call a PyUFuncGenericFunction; all arguments are addresses."""

    def generate(context: Any, builder: Any, signature: Any, addresses: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4)
        target = builder.inttoptr(addresses[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(one, pointer) for one in addresses[1:]])
        return context.get_dummy_value()

    return numba.void(*[numba.int64] * 5), generate


_call: Any = intrinsic(_typed_call)


@kernel
def _run(loop: Any, scratch: Any) -> None:
    base = np.int64(scratch.ctypes.data)
    _call(loop[0], base, base + 8 * _DIMENSIONS, base + 8 * _STEPS, loop[1])


@kernel
def unary(loop: Any, scratch: Any, x: Any, out: Any, size: int, item: int) -> None:
    """``out = f(x)`` for contiguous arrays.

    Parameters
    ----------
    loop
        Address and data of f's loop.
    scratch
        int64, shape (SCRATCH_SIZE,).
    x, out
        Arrays of at least `size` entries; may be the same.
    size
        Number of entries.
    item
        Bytes of an entry.
    """
    scratch[0], scratch[1] = np.int64(x.ctypes.data), np.int64(out.ctypes.data)
    scratch[4] = size
    scratch[8], scratch[9] = item, item
    _run(loop, scratch)


@kernel
def binary(loop: Any, scratch: Any, x: Any, y: Any, out: Any, size: int) -> None:
    """``out = f(x, y)`` for contiguous complex arrays.

    Parameters
    ----------
    loop
        Address and data of f's loop.
    scratch
        int64, shape (SCRATCH_SIZE,).
    x, y, out
        Arrays of at least `size` entries.
    size
        Number of entries.
    """
    scratch[0], scratch[1] = np.int64(x.ctypes.data), np.int64(y.ctypes.data)
    scratch[2], scratch[4] = np.int64(out.ctypes.data), size
    scratch[8], scratch[9], scratch[10] = _COMPLEX, _COMPLEX, _COMPLEX
    _run(loop, scratch)


@kernel
def total(loop: Any, scratch: Any, x: Any, size: int, out: Any) -> float:
    """Sum of a contiguous array, pairwise as ``numpy.sum`` has it.

    Parameters
    ----------
    loop
        Address and data of the loop of ``numpy.add``.
    scratch
        int64, shape (SCRATCH_SIZE,).
    x
        Doubles.
    size
        How many of them.
    out
        Room for one double.
    """
    out[0] = 0.0
    scratch[0], scratch[1] = np.int64(out.ctypes.data), np.int64(x.ctypes.data)
    scratch[2], scratch[4] = scratch[0], size
    scratch[8], scratch[9], scratch[10] = 0, _DOUBLE, 0
    _run(loop, scratch)
    return float(out[0])


@kernel
def product(
    loop: Any, scratch: Any, a: Any, b: Any, out: Any, m: int, n: int, p: int, turned: bool
) -> None:
    """``out = a @ b`` as ``numpy.matmul`` has it; a vector is a matrix of one row or column.

    Parameters
    ----------
    loop
        Address and data of matmul's loop.
    scratch
        int64, shape (SCRATCH_SIZE,).
    a
        C-contiguous, shape (m, n).
    b
        C-contiguous, shape (n, p); shape (p, n) if `turned`, for its transpose.
    out
        C-contiguous, shape (m, p).
    m, n, p
        Sizes.
    turned
        Whether the transpose of `b` is meant.
    """
    item = a.itemsize
    scratch[0], scratch[1] = np.int64(a.ctypes.data), np.int64(b.ctypes.data)
    scratch[2] = np.int64(out.ctypes.data)
    scratch[4], scratch[5], scratch[6], scratch[7] = 1, m, n, p
    scratch[8], scratch[9], scratch[10] = 0, 0, 0
    row, column = (item, n * item) if turned else (p * item, item)
    # NumPy passes no stride where there is but one entry.
    scratch[11] = n * item if m > 1 else 0
    scratch[12] = item if n > 1 else 0
    scratch[13] = row if n > 1 else 0
    scratch[14] = column if p > 1 else 0
    scratch[15] = p * item if m > 1 else 0
    scratch[16] = item if p > 1 else 0
    _run(loop, scratch)
