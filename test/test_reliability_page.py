"""The tables of tests in the pages name tests that exist."""

import re

import pytest
from loop_support import ROOT


@pytest.mark.parametrize(
    ('page', 'head', 'column'),
    [
        ('reliability', '| fault |', 5),
        ('reliability', '| promise |', 2),
        ('hardware', '| page | statement |', 3),
    ],
)
def test_every_test_that_a_page_names_exists(page, head, column):
    text = (ROOT / 'docs' / f'{page}.md').read_text()
    rows = text[text.index(head) :].partition('\n\n')[0].splitlines()[2:]
    files = [*ROOT.glob('test/test_*.py'), *ROOT.glob('src/*/test/test_*.py')]
    existing = set(re.findall(r'^def (test_\w+)', '\n'.join(f.read_text() for f in files), re.M))

    assert len(rows) > 5
    for row in rows:
        named = re.findall(r'`(test_\w+)`', row.split('|')[column])
        assert named, row
        assert set(named) <= existing, row
