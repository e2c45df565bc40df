"""A folder that can't be made is one clear message of every command that fills one."""

from pathlib import Path

import pytest

from dvs_simulation.cli import main

MIRROR = str(Path(__file__).resolve().parents[3] / 'config' / 'mirror_r1.yaml')


@pytest.mark.parametrize(
    'command',
    [
        ['simulate', '--params-file', MIRROR],
        ['reproduce_paper'],
        ['sweep', '--study', 'pixels'],
    ],
)
def test_a_file_in_the_way_is_named(command, tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    output = tmp_path / 'file' / 'folder' / 'x'

    assert main([*command, '--output', str(output)]) == 2

    error = capsys.readouterr().err
    assert f'{output.parent}' in error and "can't be made: Not a directory" in error
    assert error.count('\n') == 1


def test_a_file_is_no_folder(tmp_path, capsys):
    output = tmp_path / 'file'
    output.write_text('')

    assert main(['reproduce_paper', '--output', str(output)]) == 2

    assert f'output = {output}: is not a folder' in capsys.readouterr().err


def test_a_full_disk_is_no_traceback(tmp_path, capsys, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, 'No space left on device', 'result.json')

    monkeypatch.setattr(Path, 'write_text', full)

    assert main(['simulate', '--params-file', MIRROR, '--output', str(tmp_path)]) == 1
    assert 'No space left on device' in capsys.readouterr().err
