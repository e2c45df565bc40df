"""Public arguments are documented, and so are the errors of the suite that a function raises."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(ROOT.glob('src/dvs_*/dvs_*/**/*.py'))
ERRORS = {'ParameterError', 'MessageError'}
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Documented:
    """A public function, method or class: what it takes, raises and says."""

    name: str
    arguments: tuple[str, ...]
    raised: frozenset[str]
    docstring: str

    def section(self, title: str) -> str:
        found = re.search(rf'(?ms)^{title}\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)', self.docstring)
        return found.group(1) if found else ''

    def problems(self) -> Iterator[str]:
        """Say what is missing.

        A short docstring may name its arguments in backticks, or refer to another: "see `other`".
        """
        names = re.findall(r'(?m)^\*{0,2}(\w+(?:, \w+)*)$', self.section('Parameters'))
        documented = [name for group in names for name in group.split(', ')]
        if re.search(r'\b[Ss]ee `', self.docstring):
            return
        for name in self.arguments:
            if name not in documented and f'`{name}`' not in self.docstring:
                yield f'{self.name}: argument {name} is not documented'
        for name in documented:
            if name not in self.arguments:
                yield f'{self.name}: documents {name}, which it does not take'
        announced = set(re.findall(r'(?m)^(\w+)$', self.section('Raises')))
        announced |= set(re.findall(r'[Rr]aises? `(\w+)`', self.docstring))
        for error in sorted(self.raised - announced if 'SuiteError' not in announced else ()):
            yield f'{self.name}: raises {error}, which is not announced'


def arguments_of(function: Function) -> tuple[str, ...]:
    taken = function.args
    names = [a.arg for a in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)]
    names += [a.arg for a in (taken.vararg, taken.kwarg) if a]
    return tuple(name for name in names if name not in ('self', 'cls'))


def raised_in(function: Function) -> frozenset[str]:
    """Errors of the suite that the body raises itself and does not catch."""
    found = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            called = node.exc.func
            if isinstance(called, ast.Name) and called.id in ERRORS:
                found.add(called.id)
    return frozenset(found)


def decorated_with(node: ast.ClassDef | Function, *names: str) -> bool:
    found = ' '.join(ast.unparse(decorator) for decorator in node.decorator_list)
    return any(re.search(rf'\b{name}\b', found) for name in names)


def is_declared_parameter(value: ast.expr | None) -> bool:
    """Whether a field is made by `parameter`, which takes its description."""
    return isinstance(value, ast.Call) and ast.unparse(value.func) == 'parameter'


def documented_in(body: list[ast.stmt], prefix: str) -> Iterator[Documented]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
            yield from documented_in_class(node, f'{prefix}.{node.name}')
        elif isinstance(node, Function) and not node.name.startswith('_'):
            # Compiled kernels are internal; a property is documented where it is read, an
            # overloaded function where it is implemented.
            if decorated_with(node, 'jit', 'njit', 'setter', 'overload'):
                continue
            yield Documented(
                name=f'{prefix}.{node.name}',
                arguments=arguments_of(node),
                raised=raised_in(node),
                docstring=ast.get_docstring(node) or '',
            )


def documented_in_class(node: ast.ClassDef, name: str) -> Iterator[Documented]:
    methods = {item.name: item for item in node.body if isinstance(item, Function)}
    makers = [methods[m] for m in ('__init__', '__post_init__') if m in methods]
    fields: tuple[str, ...] = ()
    if decorated_with(node, 'dataclass'):
        fields = tuple(
            item.target.id
            for item in node.body
            if isinstance(item, ast.AnnAssign)
            and isinstance(item.target, ast.Name)
            and not item.target.id.startswith('_')
            and 'ClassVar' not in ast.unparse(item.annotation)
            and not is_declared_parameter(item.value)
        )
    elif '__init__' in methods:
        fields = arguments_of(methods['__init__'])
    is_protocol = any(ast.unparse(base).endswith('Protocol') for base in node.bases)
    if fields and not is_protocol:
        yield Documented(
            name=name,
            arguments=fields,
            raised=frozenset().union(*(raised_in(maker) for maker in makers)),
            docstring=ast.get_docstring(node) or '',
        )
    yield from documented_in(node.body, name)


def public(path: Path) -> Iterator[Documented]:
    tree = ast.parse(path.read_text(encoding='utf-8'))
    yield from documented_in(tree.body, path.stem)


def test_arguments_and_errors_are_documented() -> None:
    public_items = [item for path in MODULES for item in public(path)]
    problems = [problem for item in public_items for problem in item.problems()]

    assert len(public_items) > 1000
    assert not problems, '\n'.join(problems)


EXAMPLE = '''
class Gain:
    """A gain.

    Parameters
    ----------
    value
        The gain.

    Raises
    ------
    ParameterError
        If it is zero.
    """

    def __init__(self, value, {extra}):
        if not value:
            raise {error}('value', value, 'must not be 0')
'''


@pytest.mark.parametrize(
    ('extra', 'error', 'problem'),
    [
        ('', 'ParameterError', None),
        ('limit=1', 'ParameterError', 'm.Gain: argument limit is not documented'),
        ('', 'MessageError', 'm.Gain: raises MessageError, which is not announced'),
    ],
)
def test_this_test_finds_what_is_missing(extra: str, error: str, problem: str | None) -> None:
    body = ast.parse(EXAMPLE.format(extra=extra, error=error)).body

    problems = [problem for item in documented_in(body, 'm') for problem in item.problems()]

    assert problems == ([problem] if problem else [])
