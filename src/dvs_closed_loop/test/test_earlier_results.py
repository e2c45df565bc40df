"""Results of an earlier run stay until the next one has begun."""

import pytest

from dvs_closed_loop.running.earlier_results import kept_aside

NAMES = ('bag', 'result.json', 'figure.png')


@pytest.fixture
def folder(tmp_path):
    write(tmp_path, 'earlier')
    (tmp_path / 'mine.txt').write_text('mine')
    return tmp_path


def write(folder, text):
    (folder / 'bag').mkdir()
    (folder / 'bag' / 'bag.mcap').write_text(text)
    (folder / 'result.json').write_text(text)


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob('*')
        if path.is_file()
    }


def all_of(text):
    return {'bag/bag.mcap': text, 'result.json': text, 'mine.txt': 'mine'}


def test_a_run_that_has_begun_takes_the_place_of_the_earlier_one(folder):
    with kept_aside(folder, NAMES) as begin:
        write(folder, 'new')
        begin()

    assert contents(folder) == all_of('new')


@pytest.mark.parametrize('error', [RuntimeError, KeyboardInterrupt])
def test_a_start_that_is_refused_or_interrupted_leaves_the_earlier_one(folder, error):
    with pytest.raises(error), kept_aside(folder, NAMES):
        write(folder, 'new')
        raise error

    assert contents(folder) == all_of('earlier')


def test_a_run_that_fails_after_its_beginning_is_kept(folder):
    with pytest.raises(RuntimeError), kept_aside(folder, NAMES) as begin:
        write(folder, 'new')
        begin()
        raise RuntimeError

    assert contents(folder) == all_of('new')


def test_a_folder_without_results_stays_as_it_is(tmp_path):
    with kept_aside(tmp_path, NAMES):
        pass

    assert list(tmp_path.iterdir()) == []
