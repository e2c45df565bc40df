"""The page of the camera shows every parameter and its figures."""

import re
from pathlib import Path

import pytest

from dvs_common.scenario.parameters import CAMERA, SCHEMA

PAGE = Path(__file__).parents[3] / 'docs' / 'event_camera.md'


@pytest.mark.skipif(not PAGE.exists(), reason='the documentation is not part of an installation')
def test_every_parameter_is_listed_with_its_meaning():
    rows = re.findall(r'^\| `(\w+)` \| (.*) \|$', PAGE.read_text(encoding='utf-8'), re.MULTILINE)
    listed = {name: row.split(' | ')[-1] for name, row in rows if row.count(' | ') == 3}
    expected = {spec.name: spec.description.replace('|', '\\|') for spec in SCHEMA.of_node(CAMERA)}
    assert listed == expected


@pytest.mark.skipif(not PAGE.exists(), reason='the documentation is not part of an installation')
def test_figures_are_there():
    figures = re.findall(r'!\[[^]]+\]\(([^)]+)\)', PAGE.read_text(encoding='utf-8'))
    assert len(figures) >= 5
    assert all((PAGE.parent / figure).exists() for figure in figures)
