"""Kernels that are compiled once and kept on disk, whatever state the disk is in."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core import caching

_FunctionCache: Any = caching.FunctionCache
_Function = TypeVar('_Function', bound=Callable[..., Any])
_told = False


class _ForgivingCache(_FunctionCache):
    """A cache whose broken, foreign or unwritable files cost a compilation and nothing else."""

    def load_overload(self, *arguments: Any) -> Any:
        """Return a compiled overload; None, and a word, if what is there can't be read."""
        try:
            return super().load_overload(*arguments)
        except Exception as error:  # a foreign pickle raises anything
            _tell(f'cannot be read ({type(error).__name__}: {error})')
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a compiled overload; a word if that fails."""
        try:
            super().save_overload(*arguments)
        except Exception as error:
            _tell(f'cannot be written ({type(error).__name__}: {error})')


def kernel(function: _Function) -> _Function:
    """Compile a function with numba: no fast-math, no lock held, kept on disk where that works.

    Parameters
    ----------
    function
        Function of scalars and arrays.
    """
    compiled: Any = numba.njit(error_model='numpy', nogil=True)(function)
    if compiled is function:  # NUMBA_DISABLE_JIT
        return function
    try:
        compiled._cache = _ForgivingCache(function)
    except RuntimeError as error:  # no place at all, as in a read-only installation
        _tell(f'has no place ({error})')
    return cast(_Function, compiled)


def _tell(what: str) -> None:
    global _told
    if not _told:
        _told = True
        print(
            f'the cache of compiled kernels {what}: compiling again, a few seconds at each start',
            file=sys.stderr,
        )
