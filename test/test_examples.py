"""The notebooks in examples/ run from top to bottom, each in an interpreter of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / 'examples').glob('*.ipynb'))


def cells(notebook: Path, kind: str) -> list[str]:
    content = json.loads(notebook.read_text(encoding='utf-8'))['cells']
    return [''.join(cell['source']) for cell in content if cell['cell_type'] == kind]


@pytest.mark.parametrize('notebook', NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs_and_draws(notebook, tmp_path):
    program = '\n'.join(
        [
            *cells(notebook, 'code'),
            'for number in plt.get_fignums():',
            "    plt.figure(number).savefig(f'{number}.png')",
        ]
    )
    done = subprocess.run(
        [sys.executable, '-W', 'error::DeprecationWarning', '-c', program],
        cwd=tmp_path,
        env={**os.environ, 'MPLBACKEND': 'agg'},
        capture_output=True,
        text=True,
    )

    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob('*.png'))


@pytest.mark.parametrize('notebook', NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_begins_with_what_it_answers(notebook):
    head = cells(notebook, 'markdown')[0]

    assert head.startswith('# ')
    assert '?' in head


def test_there_are_notebooks():
    assert {'event_camera.ipynb', 'design_and_certify.ipynb'} <= {n.name for n in NOTEBOOKS}
