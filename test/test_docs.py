"""Pages that are made from the code are up to date, and pages name what exists."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from dvs_common.scenario.parameters import SCHEMA
from dvs_common.wire import topics
from dvs_common.wire.events import LABELLED_EVENT_DTYPE

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
NUMPY_NAMES = {'UINT16': 'u2', 'INT32': 'i4', 'UINT32': 'u4', 'INT8': 'i1', 'UINT8': 'u1'}


def test_the_page_of_parameters_is_not_stale():
    script = ROOT / 'scripts' / 'parameters_doc.py'
    check = subprocess.run([sys.executable, script, '--check'], capture_output=True, text=True)

    assert check.returncode == 0, check.stderr


def test_the_page_of_parameters_has_a_row_for_each():
    text = (DOCS / 'parameters.md').read_text()

    assert re.findall(r'(?m)^\| `([\w.]+)` \|', text) == list(SCHEMA)


def test_the_wire_contract_has_a_row_for_every_topic():
    text = (DOCS / 'wire_contract.md').read_text()
    rows = set(re.findall(r'(?m)^\| `([\w/]+)` \|', text))

    names = {v for k, v in vars(topics).items() if k.isupper() and isinstance(v, str)}
    assert names <= rows


def test_the_wire_contract_has_the_layout_of_an_event():
    text = (DOCS / 'wire_contract.md').read_text()
    rows = re.findall(r'(?m)^\| `(\w+)` \| (\d+) \| (\w+) \|', text)

    layout = {name: (int(offset), NUMPY_NAMES[kind]) for name, offset, kind in rows}
    assert layout == {
        name: (offset, kind.str[1:])
        for name, (kind, offset) in LABELLED_EVENT_DTYPE.fields.items()
    }


def test_the_index_lists_every_page():
    listed = set(re.findall(r'\]\((\w[\w-]*\.md)\)', (DOCS / 'README.md').read_text()))

    assert listed == {page.name for page in DOCS.glob('*.md')} - {'README.md'}


@pytest.mark.parametrize('page', sorted(DOCS.glob('*.md')), ids=lambda path: path.name)
def test_links_between_pages_lead_somewhere(page):
    targets = re.findall(r'\]\(([^)#]+)(?:#[^)]*)?\)', page.read_text())
    local = [target for target in targets if '://' not in target]

    assert not [target for target in local if not (page.parent / target).exists()]
