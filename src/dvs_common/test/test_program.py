"""What a program does where a package that it needs is not installed."""

import subprocess
import sys


def run(module, folder):
    program = f"""
import sys
from dvs_common.program import run_program
sys.argv[0] = 'tool'
sys.exit(run_program({module!r}))
"""
    return subprocess.run(
        [sys.executable, '-c', program], cwd=folder, capture_output=True, text=True
    )


def test_a_package_that_is_not_installed_is_named_in_one_line(tmp_path):
    (tmp_path / 'at_once.py').write_text('import not_installed.part\n')
    (tmp_path / 'later.py').write_text('def main():\n    import not_installed\n')

    for module in ('at_once', 'later'):
        result = run(module, tmp_path)
        expected = 'tool: needs the package not_installed, which is not installed\n'
        assert (result.returncode, result.stderr) == (1, expected)


def test_a_module_of_ours_that_is_missing_is_a_fault_with_its_traceback(tmp_path):
    (tmp_path / 'at_once.py').write_text('import dvs_made_up\n')

    assert 'Traceback' in run('at_once', tmp_path).stderr
