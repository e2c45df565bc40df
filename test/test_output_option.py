"""`--output` means the same in every command and script: the folder in which results go."""

import re
import runpy
import sys
from importlib import import_module
from pathlib import Path

import pytest

from dvs_closed_loop.cli import COMMANDS
from dvs_event_camera.cli import COMMANDS as CAMERA_COMMANDS

SCRIPTS = sorted((Path(__file__).parents[1] / 'scripts').glob('*.py'))
WITH_FIGURES = {
    path.name: path
    for path in SCRIPTS
    if path.name != 'checkout.py' and 'add_output(' in path.read_text()
}
WITH_RESULTS = {
    'closed_loop',
    'design_controller',
    'reproduce_paper',
    'report',
    'simulate',
    'simulate_video',
    'sweep',
}
PROGRAMS = {
    'closed_loop': ('dvs_closed_loop.running.closed_loop', ()),
    'convert_events': ('dvs_event_camera.tools.convert_events', ()),
    'design_controller': ('dvs_hinf_controller.design.design_tool', ()),
    'show_events': ('dvs_event_camera.tools.show_events', ()),
    **{name: ('dvs_closed_loop.cli', (name,)) for name in COMMANDS},
    **{name: ('dvs_event_camera.cli', (name,)) for name in CAMERA_COMMANDS},
}


def help_of(name, capsys, monkeypatch):
    module, arguments = PROGRAMS[name]
    monkeypatch.setattr(sys, 'argv', [name, *arguments, '--help'])
    with pytest.raises(SystemExit, match='0'):
        import_module(module).main()
    return said(capsys)


def said(capsys):
    return ' '.join(capsys.readouterr().out.partition('options:')[2].split())


def meaning(text):
    found = re.search(r'--output OUTPUT (.{21})', text)
    return found and found[1]


def test_all_subcommands_are_looked_at():
    assert len(COMMANDS) == 8
    assert {*COMMANDS, *CAMERA_COMMANDS} <= {*PROGRAMS}


@pytest.mark.parametrize('name', PROGRAMS)
def test_the_option_is_the_folder_of_the_results(name, capsys, monkeypatch):
    wanted = 'folder of the results' if name in WITH_RESULTS else None

    assert meaning(help_of(name, capsys, monkeypatch)) == wanted


def test_scripts_have_the_option_from_one_place():
    named = [path.name for path in SCRIPTS if "'--output'" in path.read_text()]

    assert named == ['checkout.py']
    assert {'scale_figure.py', 'trade_figure.py'} < {*WITH_FIGURES}


@pytest.mark.parametrize('name', WITH_FIGURES)
def test_the_option_of_a_script_is_the_folder_of_the_results(name, capsys, monkeypatch):
    monkeypatch.setattr(sys, 'argv', [name, '--help'])
    monkeypatch.syspath_prepend(WITH_FIGURES[name].parent)
    with pytest.raises(SystemExit, match='0'):
        runpy.run_path(str(WITH_FIGURES[name]), run_name='__main__')

    assert meaning(said(capsys)) == 'folder of the results'
