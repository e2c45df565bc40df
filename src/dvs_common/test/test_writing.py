"""Output files are whole or not there, and what goes wrong names the file."""

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.writing import WriteError, naming_file, whole_file, write_text


def left_in(folder):
    return sorted(file.name for file in folder.iterdir())


@given(first=st.text(), second=st.text())
def test_a_file_holds_what_was_written_last(first, second, tmp_path_factory):
    path = tmp_path_factory.mktemp('folder') / 'a.txt'
    for text in (first, second):
        write_text(path, text)

    assert path.read_bytes() == second.encode('utf-8', 'surrogatepass')
    assert left_in(path.parent) == ['a.txt']


@pytest.mark.parametrize('before', [None, 'kept'])
def test_a_draft_that_fails_leaves_everything_as_it_was(before, tmp_path):
    path = tmp_path / 'a.json'
    if before is not None:
        path.write_text(before)

    with pytest.raises(WriteError, match=r'a\.json: cannot be written: No space left'):  # noqa: SIM117
        with whole_file(path) as draft:
            draft.write_text('half')
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert (path.read_text() if path.exists() else None) == before
    assert left_in(tmp_path) == ([] if before is None else ['a.json'])


def test_what_is_no_fault_of_the_disk_is_not_renamed(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_file(tmp_path / 'a') as draft:
        draft.write_text('half')
        1 / 0  # noqa: B018

    assert left_in(tmp_path) == []


@pytest.mark.parametrize('place', ['no/such/folder/a.txt', 'file/a.txt', '.', 'file\0.txt'])
def test_a_place_where_nothing_can_be_is_named(place, tmp_path):
    (tmp_path / 'file').write_text('')

    with pytest.raises((WriteError, ValueError), match=r'cannot be written|null'):
        write_text(tmp_path / place, 'text')


def test_a_folder_of_another_user_is_named(tmp_path):
    if os.geteuid() == 0:
        pytest.skip('root may write everywhere')
    tmp_path.chmod(0o500)

    with pytest.raises(WriteError, match='Permission denied'):
        write_text(tmp_path / 'a.txt', 'text')


def test_a_link_keeps_pointing_to_what_is_written(tmp_path):
    (tmp_path / 'there').mkdir()
    (tmp_path / 'a.txt').symlink_to(tmp_path / 'there' / 'b.txt')

    write_text(tmp_path / 'a.txt', 'text')

    assert (tmp_path / 'there' / 'b.txt').read_text() == 'text'
    assert (tmp_path / 'a.txt').is_symlink()


def test_a_device_is_written_and_stays_one():
    write_text('/dev/null', 'text')

    assert Path('/dev/null').is_char_device()


def test_a_full_device_is_named():
    with pytest.raises(WriteError, match='/dev/full: cannot be written: No space left'):
        write_text('/dev/full', 'text')


def test_a_closed_pipe_is_not_a_failure_of_a_file():
    with pytest.raises(BrokenPipeError), naming_file('somewhere'):
        raise BrokenPipeError
