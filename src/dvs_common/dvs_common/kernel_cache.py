"""Kernels that are compiled once and kept on disk, whatever state the disk is in.

A compiled function holds the code of the functions that it calls and the constants that it reads.
numba compiles it again where its own file has changed, but not where theirs have. Kernels stand in
one folder with the functions and constants that they use, or name kernels of another folder, and
here a change of any file of these folders makes all their kernels compile again. What is in the
files counts, not when they were written: a copy of a folder needs no compilation.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import caching

_FunctionCache: Any = caching.FunctionCache
_IndexFile: Any = caching.IndexDataCacheFile
_Function = TypeVar('_Function', bound=Callable[..., Any])
_has_warned = False


class _FolderCache(_FunctionCache):
    """A cache that is as new as a folder; broken or foreign files cost a compilation only."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _IndexFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=_digest(_folders(function)),
        )

    def load_overload(self, *arguments: Any) -> Any:
        """Return a compiled overload; None if what is there can't be read."""
        try:
            return super().load_overload(*arguments)
        except Exception as error:  # a foreign pickle raises anything
            _warn_once(f'cannot be read ({type(error).__name__}: {error})')
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a compiled overload; a line on stderr if that fails."""
        try:
            super().save_overload(*arguments)
        except Exception as error:
            _warn_once(f'cannot be written ({type(error).__name__}: {error})')


def _folders(function: Callable[..., Any]) -> tuple[Path, ...]:
    """Folder of a function, and those of the kernels that its module names."""
    named = (getattr(entry, 'py_func', None) for entry in function.__globals__.values())
    files = {inspect.getfile(one) for one in (function, *named) if one is not None}
    return tuple(sorted({Path(file).parent for file in files}))


@cache
def _digest(folders: tuple[Path, ...]) -> bytes:
    """SHA-256 of the Python files of folders."""
    digest = hashlib.sha256()
    for path in (path for folder in folders for path in sorted(folder.glob('*.py'))):
        source = path.read_bytes()
        digest.update(f'{path.name}\n{len(source)}\n'.encode() + source)
    return digest.digest()


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
        compiled._cache = _FolderCache(function)
    except RuntimeError as error:  # no place at all, as in a read-only installation
        _warn_once(f'has no place ({error})')
    return cast(_Function, compiled)


def _warn_once(what: str) -> None:
    global _has_warned
    if not _has_warned:
        _has_warned = True
        print(
            f'the cache of compiled kernels {what}: compiling again, a few seconds at each start',
            file=sys.stderr,
        )
