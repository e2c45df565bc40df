"""Docs, docstrings, comments, messages and test names are in plain terms of the field.

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
    (?:says?|said)\ so | fights? | fought                      # logs, prints, warns; limits
    )\b"""
)
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
    """Comments, strings (docstrings and messages among them), names of tests and functions."""
    text = path.read_text(encoding='utf-8')
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (
            tokenize.COMMENT,
            tokenize.STRING,
            getattr(tokenize, 'FSTRING_MIDDLE', -1),
        ):
            yield token.string
    for node in ast.walk(ast.parse(text)):
        named = isinstance(node, ast.FunctionDef) and node.name.startswith('test_')
        if named or ('test' not in path.parts and isinstance(node, ast.FunctionDef)):
            yield node.name.replace('_', ' ')


def found_in(texts):
    return [
        ' '.join(line.split())
        for text in texts
        for line in text.splitlines()
        if REPLACED.search(line)
    ]


@pytest.mark.parametrize('path', TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_page_uses_no_word_that_was_replaced(path):
    assert found_in([path.read_text(encoding='utf-8')]) == []


def test_no_docstring_comment_message_or_test_name_uses_one():
    found = {path.relative_to(ROOT).as_posix(): found_in(prose_of(path)) for path in MODULES}

    assert {name: lines for name, lines in found.items() if lines} == {}


def test_this_test_finds_what_it_looks_for(tmp_path):
    (tmp_path / 'm.py').write_text(
        'def test_it_hears():\n    """A node that feels well."""\n    heard = "nobody"  # deaf\n'
    )

    (tmp_path / 'n.py').write_text('def listen_to():\n    pass\n')

    assert len(found_in(prose_of(tmp_path / 'm.py'))) == 4
    assert len(found_in(prose_of(tmp_path / 'n.py'))) == 1
