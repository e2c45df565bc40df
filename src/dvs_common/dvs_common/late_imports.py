"""What other packages import by name and do not use: loaded at its first use, or left out.

``from numpy import *`` in SciPy loads the Fortran parser, the test tools, masked arrays and more,
a third of the time that `scipy.linalg` takes to import. The first message of ROS loads the
generator of messages with its parser.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType

_PARTS = ('ctypeslib', 'f2py', 'ma', 'matlib', 'polynomial', 'rec', 'testing')


def import_less() -> None:
    """Load these parts of NumPy at their first use, and no generator of ROS messages at all."""
    sys.meta_path.insert(0, _BeforeScipy())
    # The package goes without it.
    sys.modules['rosidl_generator_py.generate_py_impl'] = None  # type: ignore[assignment]


class _BeforeScipy:
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
