"""The compiled kernels, if this machine has them."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

from dvs_common.errors import ParameterError

BACKENDS = ('auto', 'numba', 'numpy')
# Pixels or events from which compiled code pays.
WORTH_COMPILING = 4096


@cache
def kernels() -> Any | None:
    """Module `pixel_kernels`; None if numba is not installed or may not compile."""
    try:
        if importlib.import_module('numba').config.DISABLE_JIT:
            return None
        return importlib.import_module('dvs_event_camera.pixels.pixel_kernels')
    except (ImportError, RuntimeError, ValueError):  # the last by NUMBA_NUM_THREADS=0
        return None


def kernels_for(backend: str, size: int, *, worth: int = WORTH_COMPILING) -> Any | None:
    """Kernels for an amount of work, or None where NumPy is to do it.

    Parameters
    ----------
    backend
        `numba`, `numpy`, or `auto`: numba if it is there and the work is worth it.
    size
        Amount of work.
    worth
        Amount from which compiled code pays: importing numba takes a second, and compiling, once,
        more.

    Raises
    ------
    ParameterError
        If `backend` is unknown or not installed.
    """
    if backend not in BACKENDS:
        raise ParameterError('backend', backend, f'must be one of {", ".join(BACKENDS)}')
    if backend == 'numpy' or (backend == 'auto' and size < worth):
        return None
    found = kernels()
    if found is None and backend == 'numba':
        raise ParameterError(
            'backend',
            backend,
            'needs the Python package numba, which NUMBA_DISABLE_JIT must not forbid to compile',
        )
    return found
