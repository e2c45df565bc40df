"""The page of faults names tests that exist."""

import re

from loop_support import ROOT

PAGE = ROOT / 'docs' / 'reliability.md'


def test_every_test_that_the_page_names_exists():
    faults = PAGE.read_text().partition('\n## ')[0]
    rows = [line for line in faults.splitlines() if line.startswith('| ')][1:]
    files = [*ROOT.glob('test/test_*.py'), *ROOT.glob('src/*/test/test_*.py')]
    existing = set(re.findall(r'^def (test_\w+)', '\n'.join(f.read_text() for f in files), re.M))

    for row in rows:
        named = re.findall(r'`(test_\w+)`', row.split('|')[5])
        assert named, row
        assert set(named) <= existing, row
