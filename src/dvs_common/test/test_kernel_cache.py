"""Compiled kernels on disk are as new as the files that they were made of."""

import os
import subprocess
import sys

import pytest

pytest.importorskip('numba')
pytestmark = pytest.mark.processes

CALLED = 'from dvs_common.kernel_cache import kernel\n\n@kernel\ndef part(x):\n    return {} * x\n'
CALLER = (
    'from called import part\nfrom constants import SHIFT\n'
    'from dvs_common.kernel_cache import kernel\n\n'
    '@kernel\ndef whole(x):\n    return part(x) + SHIFT\n'
)
RUN = 'import caller; print(caller.whole(20), sum(caller.whole.stats.cache_hits.values()))'


def run(folder):
    """Value of the kernel, and how many overloads came from the disk."""
    result = subprocess.run(
        [sys.executable, '-B', '-c', RUN],
        cwd=folder,
        env={**os.environ, 'NUMBA_CACHE_DIR': str(folder / 'cache')},
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(map(int, result.stdout.split()))


def test_a_change_of_a_function_or_constant_that_a_kernel_uses_compiles_it_again(tmp_path):
    (tmp_path / 'called.py').write_text(CALLED.format(2))
    (tmp_path / 'constants.py').write_text('SHIFT = 2\n')
    (tmp_path / 'caller.py').write_text(CALLER)

    assert run(tmp_path) == (42, 0)
    assert run(tmp_path) == (42, 1)

    (tmp_path / 'called.py').write_text(CALLED.format(3))
    assert run(tmp_path) == (62, 0)

    (tmp_path / 'constants.py').write_text('SHIFT = 7\n')
    assert run(tmp_path) == (67, 0)
    os.utime(tmp_path / 'caller.py', (0, 0))
    assert run(tmp_path) == (67, 1)


def test_a_change_of_a_kernel_in_another_folder_compiles_those_again_that_name_it(tmp_path):
    (tmp_path / 'elsewhere').mkdir()
    caller = CALLER.replace('from called', 'from elsewhere.called')
    (tmp_path / 'elsewhere' / 'called.py').write_text(CALLED.format(2))
    (tmp_path / 'constants.py').write_text('SHIFT = 2\n')
    (tmp_path / 'caller.py').write_text(caller)

    assert run(tmp_path) == (42, 0)
    assert run(tmp_path) == (42, 1)

    (tmp_path / 'elsewhere' / 'called.py').write_text(CALLED.format(3))
    assert run(tmp_path) == (62, 0)
