"""`--output` means the same in every command: the folder in which results go."""

import re
import sys
from importlib import import_module

import pytest

from dvs_closed_loop.cli import COMMANDS
from dvs_event_camera.cli import COMMANDS as CAMERA_COMMANDS

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
    return ' '.join(capsys.readouterr().out.partition('options:')[2].split())


def test_all_subcommands_are_looked_at():
    assert len(COMMANDS) == 8
    assert {*COMMANDS, *CAMERA_COMMANDS} <= {*PROGRAMS}


@pytest.mark.parametrize('name', PROGRAMS)
def test_the_option_is_the_folder_of_the_results(name, capsys, monkeypatch):
    found = re.search(r'--output OUTPUT (.{21})', help_of(name, capsys, monkeypatch))

    assert bool(found) == (name in WITH_RESULTS)
    assert not found or found[1] == 'folder of the results'
