"""Parts of NumPy that SciPy asks for by name and does not use are loaded when something uses them.

``from numpy import *`` in SciPy loads the Fortran parser, the test tools, masked arrays and more,
a third of the time that `scipy.linalg` takes to import.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType

_PARTS = ('ctypeslib', 'f2py', 'ma', 'matlib', 'polynomial', 'rec', 'testing')


def let_numpy_wait() -> None:
    """Let these parts of NumPy wait for their first use, from the first import of SciPy on."""
    sys.meta_path.insert(0, _BeforeScipy())


class _BeforeScipy(MetaPathFinder):
    """Finds nothing: the first import of SciPy passes here."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name == 'scipy':
            sys.meta_path.remove(self)
            for part in _PARTS:
                _load_late('numpy', part)
        return None


def _load_late(package: str, part: str) -> None:
    name = f'{package}.{part}'
    spec = None if name in sys.modules else find_spec(name)
    if spec is None or spec.loader is None:
        return
    spec.loader = LazyLoader(spec.loader)
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    setattr(sys.modules[package], part, module)
