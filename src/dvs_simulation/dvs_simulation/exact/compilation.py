"""The compiled inner loop where numba is installed, the same source interpreted where it is not.

Both run the same IEEE operations in the same order (no fast-math, no contraction), so that they
give the same events; only the speed differs.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator

_Function = TypeVar('_Function', bound=Callable[..., Any])
_KERNEL = 'dvs_simulation.exact.kernel'
_interpret = False


def numba_available() -> bool:
    """Whether numba can be imported."""
    return importlib.util.find_spec('numba') is not None


def jit(function: _Function) -> _Function:
    """Compile `function` with numba, or return it as it is while a kernel is loaded interpreted.

    Parameters
    ----------
    function
        Function of scalars, arrays and named tuples.
    """
    if _interpret:
        return function
    cached: Any = importlib.import_module('dvs_common.kernel_cache')
    compiled: _Function = cached.kernel(function)
    return compiled


@cache
def load_kernel(*, compiled: bool) -> ModuleType:
    """Inner loop of the automaton.

    Parameters
    ----------
    compiled
        False loads the folder a second time without numba: slow, identical results.

    Raises
    ------
    ModuleNotFoundError
        If `compiled` and numba is not installed.
    """
    if compiled:
        return importlib.import_module(f'{_KERNEL}.run')
    name = f'{_KERNEL}_interpreted'
    folder = Path(__file__).with_name('kernel')
    spec = importlib.util.spec_from_file_location(
        name, folder / '__init__.py', submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    sys.modules[name] = importlib.util.module_from_spec(spec)
    with _interpreted():
        return importlib.import_module(f'{name}.run')


@contextmanager
def _interpreted() -> Iterator[None]:
    global _interpret
    _interpret = True
    try:
        yield
    finally:
        _interpret = False
