"""A command writes its file where `--output` points: at a folder or at the file itself."""

import pytest

from dvs_common.errors import ParameterError
from dvs_common.output_folder import output_file, output_folder


def test_a_folder_is_made_with_its_parents(tmp_path):
    assert output_folder(tmp_path / 'a' / 'b').is_dir()
    assert output_folder(tmp_path / 'a' / 'b').is_dir()


def test_a_file_goes_into_the_folder_or_is_named_itself(tmp_path):
    assert output_file(tmp_path / 'a', 'x.csv') == tmp_path / 'a' / 'x.csv'
    assert (tmp_path / 'a').is_dir()
    assert output_file(tmp_path / 'mine.csv', 'x.csv') == tmp_path / 'mine.csv'


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / 'file').write_text('')

    with pytest.raises(ParameterError, match='is not a folder'):
        output_file(tmp_path / 'file', 'x.csv')
