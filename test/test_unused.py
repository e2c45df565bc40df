"""Every function, method and class has a caller: a guard that nothing calls guards nothing."""

import ast
import re
from collections import Counter
from pathlib import Path

from loop_support import ROOT

PACKAGES = [
    file for file in sorted((ROOT / 'src').glob('*/dvs_*/**/*.py')) if '/test/' not in str(file)
]
CALLERS = [
    *PACKAGES,
    *sorted((ROOT / 'src').glob('*/launch/*.py')),
    *sorted((ROOT / 'src').glob('*/*/__init__.pyi')),
    *sorted((ROOT / 'scripts').glob('*.py')),
    *sorted((ROOT / 'examples').glob('**/*.py')),
    *sorted((ROOT / 'docs').glob('*.md')),
]
# Called by name from elsewhere.
BY_OTHERS = {'create_module': "Python's import system"}


def unused(files: list[Path], callers: list[Path]) -> set[str]:
    """Names that are defined in `files` and stand nowhere else."""
    words = Counter(word for file in callers for word in re.findall(r'\w+', file.read_text()))
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return {
        node.name
        for file in files
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, kinds) and not node.name.startswith('__') and words[node.name] == 1
    }


def test_nothing_is_without_a_caller():
    assert unused(PACKAGES, CALLERS) == set(BY_OTHERS)


def test_a_method_that_nothing_calls_is_seen(tmp_path):
    file = tmp_path / 'module.py'
    file.write_text('class Node:\n    def _guarded(self): ...\n\n\nNode()\n')

    assert unused([file], [file]) == {'_guarded'}
