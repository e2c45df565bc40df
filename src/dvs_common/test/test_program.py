"""A program without a package that it needs, and one whose output is no longer read."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


def run(module, folder, **variables):
    program = f"""
import sys
from pathlib import Path
from dvs_common.program import run_program
sys.argv[0] = 'tool'
sys.exit(run_program({module!r}))
"""
    return subprocess.run(
        [sys.executable, '-c', program],
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize('wanted', ['error', 'error::DeprecationWarning'])
def test_a_warning_of_a_library_ends_no_program_whatever_the_options_of_python(wanted, tmp_path):
    (tmp_path / 'warns.py').write_text(
        'import os, warnings\nwarnings.warn("old", DeprecationWarning)\n'
        'def main():\n    print(os.environ["PYTHONWARNINGS"])\n    return 0\n'
    )

    result = run('warns', tmp_path, PYTHONWARNINGS=wanted)

    assert (result.returncode, result.stdout) == (0, 'default\n'), result.stderr
    assert 'DeprecationWarning: old' in result.stderr


@pytest.mark.parametrize(
    ('wanted', 'left'), [('0', None), ('-2', None), ('4', '4'), ('many', 'many')]
)
def test_a_number_of_threads_that_numba_can_not_start_with_is_left_out(wanted, left, tmp_path):
    (tmp_path / 'prints.py').write_text(
        'import os\ndef main():\n    print(os.environ.get("NUMBA_NUM_THREADS"))\n    return 0\n'
    )

    result = run('prints', tmp_path, NUMBA_NUM_THREADS=wanted)

    assert (result.returncode, result.stdout) == (0, f'{left}\n')
    line = f'tool: NUMBA_NUM_THREADS={wanted} is left out: it must be at least 1\n'
    assert result.stderr == ('' if left else line)


def test_a_package_that_is_not_installed_is_named_in_one_line(tmp_path):
    (tmp_path / 'at_once.py').write_text('import not_installed.part\n')
    (tmp_path / 'later.py').write_text('def main():\n    import not_installed\n')

    for module in ('at_once', 'later'):
        result = run(module, tmp_path)
        expected = 'tool: needs the package not_installed, which is not installed\n'
        assert (result.returncode, result.stderr) == (1, expected)


@pytest.mark.parametrize(
    ('missing', 'extra'),
    [('matplotlib', 'dvs_simulation[plot]'), ('rclpy', 'dvs_simulation[ros]'), ('numpy', '')],
)
def test_the_extra_that_brings_a_missing_package_is_named(missing, extra, tmp_path):
    metadata = tmp_path / 'dvs_simulation-0.1.0.dist-info' / 'METADATA'
    metadata.parent.mkdir()
    metadata.write_text(
        'Metadata-Version: 2.1\nName: dvs_simulation\nVersion: 0.1.0\nRequires-Dist: numpy\n'
        'Requires-Dist: matplotlib>=3.6; extra == "plot"\n'
        'Requires-Dist: ros-jazzy-rclpy[fastrtps]==7.1.6; extra == "ros"\n'
    )
    (tmp_path / 'dvs_simulation').mkdir()
    (tmp_path / 'dvs_simulation' / '__init__.py').write_text('')
    (tmp_path / 'dvs_simulation' / 'tool.py').write_text(
        f'raise ModuleNotFoundError(name={missing!r})\n'
    )

    result = run('dvs_simulation.tool', tmp_path)

    said = f'tool: needs the package {missing}, which is not installed'
    assert result.stderr == f'{said}; it comes with {extra}\n' if extra else f'{said}\n'


def test_a_module_of_ours_that_is_missing_is_a_fault_with_its_traceback(tmp_path):
    (tmp_path / 'at_once.py').write_text('import dvs_made_up\n')

    assert 'Traceback' in run('at_once', tmp_path).stderr


@pytest.mark.parametrize('lines', [2, 100_000])
@pytest.mark.parametrize('unbuffered', [False, True])
def test_output_that_is_no_longer_read_ends_a_program_quietly(lines, unbuffered, tmp_path):
    (tmp_path / 'prints.py').write_text(
        f'import time\n\ndef main():\n    time.sleep(0.3)\n    for k in range({lines}):\n'
        '        print(k)\n    return 0\n'
    )
    program = (
        "import sys; from dvs_common.program import run_program; sys.exit(run_program('prints'))"
    )
    flags = ['-u'] if unbuffered else []
    process = subprocess.Popen(
        [sys.executable, *flags, '-c', program],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    process.stdout.close()
    errors = process.stderr.read()

    assert (process.wait(), errors) == (0, b'')


def test_a_broken_pipe_elsewhere_is_a_fault_with_its_traceback(tmp_path):
    (tmp_path / 'fails.py').write_text('def main():\n    raise BrokenPipeError\n')

    assert 'BrokenPipeError' in run('fails', tmp_path).stderr


def test_output_onto_a_full_disk_is_one_line(tmp_path):
    (tmp_path / 'prints.py').write_text('def main():\n    print(1)\n    return 0\n')
    program = (
        "import sys; from dvs_common.program import run_program; sys.exit(run_program('prints'))"
    )
    with Path('/dev/full').open('w') as full:
        result = subprocess.run(
            [sys.executable, '-c', program], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE
        )

    assert result.returncode == 1
    assert result.stderr == b'-c: standard output: No space left on device\n'


def test_parts_of_numpy_that_scipy_only_names_are_loaded_at_their_first_use(tmp_path):
    (tmp_path / 'uses.py').write_text(
        'import sys\nimport numpy\nimport scipy.linalg\n'
        'def main():\n'
        '    heavy = ("numpy.f2py.crackfortran", "numpy.testing._private", "numpy.ma.core")\n'
        '    print(*(name in sys.modules for name in heavy))\n'
        '    print(numpy.ma.masked_less(numpy.arange(4), 2).sum())\n'
        '    from numpy.testing import assert_array_equal\n'
        '    assert_array_equal(numpy.polynomial.Polynomial([1, 2])(3), 7)\n'
        '    print(*(name in sys.modules for name in heavy))\n'
        '    return 0\n'
    )

    result = run('uses', tmp_path)

    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines() == ['False False False', '5', 'False True True']


def test_no_message_of_ros_loads_the_generator_of_messages(tmp_path):
    (tmp_path / 'uses.py').write_text(
        'import sys\nfrom std_msgs.msg import Header\n'
        'def main():\n'
        '    Header.__import_type_support__()\n'
        '    print(Header._TYPE_SUPPORT is not None, "rosidl_parser.parser" in sys.modules)\n'
        '    return 0\n'
    )

    result = run('uses', tmp_path)

    assert (result.returncode, result.stdout) == (0, 'True False\n'), result.stderr


def test_garbage_is_searched_for_again_when_a_program_has_imported(tmp_path):
    (tmp_path / 'asks.py').write_text(
        'import gc\nenabled = gc.isenabled()\n'
        'def main():\n    print(enabled, gc.isenabled(), gc.get_freeze_count() > 1000)\n'
        '    return 0\n'
    )

    assert run('asks', tmp_path).stdout == 'False True True\n'
