"""Names that a package exports without importing them before they are used (PEP 562)."""

from __future__ import annotations

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_exports(package: str, file: str) -> tuple[Callable[[str], Any], list[str]]:
    """Return `__getattr__` and `__all__` of a package from its stub, ``__init__.pyi``.

    The stub is what type checkers read: one ``from module import Name as Name`` a line, or
    ``Other = Name``. So a name is written once.

    Parameters
    ----------
    package
        `__name__` of the package.
    file
        `__file__` of the package.
    """
    tree = ast.parse(Path(file).with_suffix('.pyi').read_text(encoding='utf-8'))
    origins = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    for node in tree.body:
        if isinstance(node, ast.Assign):
            origins[ast.unparse(node.targets[0])] = origins[ast.unparse(node.value)]

    def getattr_(name: str) -> Any:
        if name not in origins:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        module, original = origins[name]
        return getattr(import_module(module), original)

    return getattr_, sorted(origins)
