"""What a user has set for other programs does not change what the suite does."""

import os
import subprocess
import sys

import pytest
from loop_support import CONFIG, environment, program

FIGURE = """
import sys
from pathlib import Path
from dvs_common.drawing import Figure, drawing
with drawing():
    figure = Figure()
    figure.subplots().plot([1, 2, 4])
    figure.savefig(sys.argv[1], metadata={'Software': None})
"""


def figure_drawn(path, folder, **variables):
    result = subprocess.run(
        [sys.executable, '-c', FIGURE, str(path)],
        env={**os.environ, **variables},
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    return path.read_bytes()


@pytest.mark.parametrize(
    'variables',
    [
        {'MPLBACKEND': 'module://no_such_package.backend'},
        {'MPLBACKEND': 'TkAgg'},
        {'MPLBACKEND': 'no backend at all'},
        {'MPLCONFIGDIR': '/proc/no/such/folder'},
        {'PYTHONWARNINGS': 'error'},
        {'LC_ALL': 'C', 'PYTHONOPTIMIZE': '2'},
    ],
)
def test_a_figure_is_the_same_whatever_is_set_around_it(variables, tmp_path):
    plain = figure_drawn(tmp_path / 'plain.png', tmp_path)

    assert figure_drawn(tmp_path / 'other.png', tmp_path, **variables) == plain


def test_a_matplotlibrc_of_the_user_is_left_out(tmp_path):
    plain = figure_drawn(tmp_path / 'plain.png', tmp_path)
    (tmp_path / 'matplotlibrc').write_text(
        'text.usetex: True\nfigure.dpi: 30\nsavefig.format: pdf\nbackend: TkAgg\n'
    )

    assert figure_drawn(tmp_path / 'other.png', tmp_path) == plain


@pytest.mark.parametrize('home', [None, '/proc/no/such/folder'], ids=['no HOME', 'read-only HOME'])
def test_a_home_without_a_log_folder_is_named_with_the_remedy(home, domain, tmp_path):
    variables = {
        k: v for k, v in environment(domain).items() if not k.startswith(('HOME', 'ROS_LO'))
    }
    if home:
        variables['HOME'] = home
    for command in (
        [program('event_camera')],
        [program('closed_loop'), '--params-file', CONFIG / 'mirror_r1.yaml', '--output', tmp_path],
    ):
        run = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=60)

        assert run.returncode == 2
        # rcl and matplotlib may say something of their own before.
        assert 'set HOME, ROS_HOME or ROS_LOG_DIR' in run.stderr.splitlines()[-1], run.stderr
        assert 'Traceback' not in run.stderr


def with_shared_memory(kilobytes, filled, command, domain):
    """Run a command in a mount namespace whose /dev/shm has a size of its own."""
    mounted = (
        f'mount -t tmpfs -o size={kilobytes}k none /dev/shm && '
        f'{{ head -c {filled}k /dev/zero >/dev/shm/x 2>/dev/null; exec "$@"; }}'
    )
    if subprocess.run(['unshare', '-m', 'true'], capture_output=True).returncode:
        pytest.skip('needs the right to unshare mounts')
    return subprocess.run(
        ['unshare', '-m', 'bash', '-c', mounted, 'bash', *map(str, command)],
        env=environment(domain),
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_a_full_shared_memory_is_named_and_ends_no_program_by_a_bus_error(domain, tmp_path):
    command = [program('dvs_closed_loop'), 'record', tmp_path / 'bag', '--duration', '0.1']

    full = with_shared_memory(4, 8, command, domain)
    small = with_shared_memory(400, 100, command, domain)

    assert full.returncode == 1
    assert full.stderr == 'dvs_closed_loop: /dev/shm is full, and ROS needs some of it\n'
    assert small.returncode == 0, small.stderr
    assert 'messages go by UDP alone' in small.stderr
