"""Modules of compiled kernels: imported late, and without a cache if there is no place for one.

numba takes a second to import.
"""

from __future__ import annotations

import importlib
from typing import Any

from dvs_common.errors import ParameterError


def compiled(module: str) -> Any:
    """Import a module of kernels.

    Parameters
    ----------
    module
        Full name.

    Raises
    ------
    ParameterError
        If numba is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ParameterError('module', module, 'needs the Python package numba') from None
