"""Docs, docstrings, comments, messages and identifiers are in plain terms of the field.

Nodes publish, subscribe and receive; a program prints, reports or refuses. Here are words that
were replaced, because a reader has to guess what they mean.
"""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
REPLACED = re.compile(
    r"""(?xi)\b(?:
    hears? | heard | hearing | deaf | overhears? |           # receives, subscribes to
    somebody | anybody | nobody | whoever | strangers? |     # a subscriber, another program
    feels? | feeling |                                       # health
    no\ light\ does | while\ (?:someone|nobody)\ listens |   # not physically possible; subscribers
    listens?\ to | worth\ listening |
    speaks? | spoke | believes? | believed |                 # publishes, uses, assumes, takes
    tells | told(?!\ apart) |                                # gives, reports, shows
    insists? | unheard | costs\ a\ word | without\ a\ word |   # a line of warning
    (?:says?|said)\ so | fights? | fought |                    # logs, prints, warns; limits
    (?:stays|to\ stay)\ on | in(?:to)?\ the\ dark | darkness |   # a luminosity is (not) positive
    (?:goes|go|gone|went)\ dark | dark\ (?:runs?|in\ spite) | meaningless\ light |
    lights?\ (?:is|are|was|goes|went)\ (?:out|promised) | loses?\ the\ light |
    life | lives | swallows? |                                 # an earlier run, an epoch
    (?:long|short)\ way | unlucky | anchors?\ tell |            # general, fast path; worst
    blind | company                                            # without pixels; another loop
    )\b"""
)
# In identifiers alone: plain words elsewhere. A file's `tell` is Python's own name.
REPLACED_NAMES = re.compile(r'(?i)\b(?:listen|say|says|(?<=\ )tell)\b')
TEXTS = [
    *sorted(ROOT.glob('*.md')),
    *sorted(ROOT.glob('*.rst')),
    *sorted(ROOT.glob('docs/*.md')),
    *sorted(ROOT.glob('examples/**/*.md')),
    *sorted(ROOT.glob('src/*/CHANGELOG.rst')),
    *sorted(ROOT.glob('config/*.yaml')),
    *sorted(ROOT.glob('scripts/*.sh')),
    *sorted(ROOT.glob('src/*/dvs_*/**/web/*')),
    *sorted(ROOT.glob('src/*/dvs_*/**/*.j2')),
]
MODULES = [
    path
    for folder in ('src', 'scripts', 'test', 'examples')
    for path in sorted((ROOT / folder).rglob('*.py'))
    if path != Path(__file__)
]


def prose_of(path):
    """Comments and strings, docstrings and messages among them."""
    text = path.read_text(encoding='utf-8')
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (
            tokenize.COMMENT,
            tokenize.STRING,
            getattr(tokenize, 'FSTRING_MIDDLE', -1),
        ):
            yield token.string


def names_of(path):
    """Names that a module gives: to functions, classes, arguments, attributes and variables."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.name
            case ast.arg():
                yield node.arg
            case ast.Name(ctx=ast.Store()):
                yield node.id
            case ast.Attribute(ctx=ast.Store()):
                yield node.attr
            case ast.alias(asname=str()):
                yield node.asname
            case (
                ast.ExceptHandler(name=str()) | ast.MatchAs(name=str()) | ast.MatchStar(name=str())
            ):
                yield node.name


def as_words(name):
    """An identifier with spaces in place of underscores and before capitals."""
    return re.sub(r'_|(?<=[a-z0-9])(?=[A-Z])', ' ', name)


def found_in(texts):
    return [
        ' '.join(line.split())
        for text in texts
        for line in text.splitlines()
        if REPLACED.search(line)
    ]


def found_names(names):
    words = {name: as_words(name) for name in names}
    return sorted(
        name
        for name, spaced in words.items()
        if REPLACED.search(spaced) or REPLACED_NAMES.search(spaced)
    )


@pytest.mark.parametrize('path', TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_page_uses_no_word_that_was_replaced(path):
    assert found_in([path.read_text(encoding='utf-8')]) == []


def test_no_docstring_comment_or_message_uses_one():
    found = {path.relative_to(ROOT).as_posix(): found_in(prose_of(path)) for path in MODULES}

    assert {name: lines for name, lines in found.items() if lines} == {}


def test_no_name_of_a_function_argument_attribute_or_variable_uses_one():
    found = {path.relative_to(ROOT).as_posix(): found_names(names_of(path)) for path in MODULES}

    assert {module: names for module, names in found.items() if names} == {}


def test_this_test_finds_what_it_looks_for(tmp_path):
    module = tmp_path / 'm.py'
    module.write_text(
        'class InTheDark:\n'
        '    """A node that feels well."""\n'
        '    def listen(self, believed, *, is_blind, **tells):  # deaf\n'
        '        self._heard_s = "a former life"\n'
        '        for told, self.file in tells.tell():\n'
        '            _COMPANY: int = 1\n'
        'def _tell(): pass\n'
        'def tell(listening, listener): return listener.heard\n'
        'lambda lost_life: 0\n'
        'import a as nobody\n'
    )

    assert len(found_in(prose_of(module))) == 3
    assert found_names(names_of(module)) == [
        'InTheDark',
        '_COMPANY',
        '_heard_s',
        '_tell',
        'believed',
        'is_blind',
        'listen',
        'lost_life',
        'nobody',
        'tells',
        'told',
    ]


@pytest.mark.parametrize(
    'line',
    [
        'from its start: light stays on',
        'the light is out',
        'a run that ends in the dark',
        'a pixel went dark',
        'tests hold each against the long way round',
        'an anchor at an unlucky instant',
        'unknown until anchors tell',
        'number of this life of the sensor',
    ],
)
def test_a_phrase_that_was_replaced_is_found(line):
    assert found_in([line]) == [line]
