"""scripts/setup.sh: says clearly what is missing, and uses a ROS from apt where there is one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from loop_support import CONFIG, ROOT

TOOLS = ('awk', 'basename', 'bash', 'cat', 'cut', 'df', 'dirname', 'env', 'find', 'grep', 'mktemp')
TOOLS += ('rm', 'sha256sum', 'tail', 'uname')


@pytest.fixture
def checkout(tmp_path):
    """Scripts and requirements in a directory of their own."""
    shutil.copytree(ROOT / 'scripts', tmp_path / 'repo' / 'scripts')
    for file in ROOT.glob('requirements*.txt'):
        shutil.copy(file, tmp_path / 'repo')
    return tmp_path / 'repo'


@pytest.fixture
def tools(tmp_path):
    """A PATH with nothing on it but what the scripts need, and no Python."""
    folder = tmp_path / 'bin'
    folder.mkdir()
    for tool in TOOLS:
        (folder / tool).symlink_to(shutil.which(tool))
    return folder


def program(folder: Path, name: str, text: str):
    (folder / name).unlink(missing_ok=True)
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)


def setup(checkout, tools, *, become=(), **environment):
    return subprocess.run(
        [*become, checkout / 'scripts' / 'setup.sh'],
        env={'PATH': str(tools), 'HOME': '/tmp', 'DVS_ROS': 'wheels', **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )


def said(run, message):
    assert run.returncode == 1
    assert message in run.stderr
    return True


def test_missing_python_is_named(checkout, tools):
    assert said(setup(checkout, tools), 'no Python 3.10 to 3.13 found')


def test_an_unsuitable_python_is_not_taken(checkout, tools):
    program(tools, 'python3', '#!/bin/sh\nexit 1\n')
    assert said(setup(checkout, tools), 'no Python 3.10 to 3.13 found')


def test_missing_venv_is_named(checkout, tools):
    program(
        tools,
        'python3',
        f'#!/bin/sh\n[ "$2" = venv ] && exit 1\nexec {sys.executable} "$@"\n',
    )
    assert said(setup(checkout, tools), 'apt install python3-venv')
    assert not (checkout / '.venv').exists()


def test_a_full_disk_is_named(checkout, tools):
    (tools / 'python3').symlink_to(sys.executable)
    program(tools, 'df', '#!/bin/sh\necho header\necho disk 100 90 10240 9% /\n')
    assert said(setup(checkout, tools), 'only 10 MB of disk are free')


def test_a_checkout_of_another_user_is_named(checkout, tools, another_user):
    for tool in ('id', 'setpriv', 'stat'):
        (tools / tool).symlink_to(shutil.which(tool))
    (tools / 'python3').symlink_to(sys.executable)
    assert said(setup(checkout, tools, become=another_user), "can't be written by")


def test_a_missing_index_is_named(checkout, tools):
    program(tools, 'python3', f'#!/bin/sh\nexec {sys._base_executable} "$@"\n')
    run = setup(
        checkout,
        tools,
        PIP_CONFIG_FILE='/dev/null',
        PIP_INDEX_URL='http://127.0.0.1:9/',
        PIP_NO_INDEX='0',
        PIP_RETRIES='0',
    )
    assert said(run, 'is there a network, or a package index?')


def test_run_passes_exit_code_and_names_what_is_not_there():
    run = ROOT / 'scripts' / 'run.sh'
    bad = ['dvs_plant_sim', 'plant_sim', '--ros-args', '-p', 'event_treshold:=1.0']
    assert subprocess.run([run, *bad], capture_output=True).returncode == 2
    missing = subprocess.run([run, 'dvs_plant_sim', 'none'], capture_output=True, text=True)
    assert missing.returncode == 1
    assert 'no executable none in package dvs_plant_sim' in missing.stderr


@pytest.mark.parametrize('packages', ['there', pytest.param('fetched', marks=pytest.mark.long)])
def test_a_ros_from_apt_is_used_in_a_path_with_a_space_and_an_umlaut(packages, tmp_path, domain):
    """A prefix like /opt/ros/jazzy that leads to the wheels stands in for apt's.

    In the short form Python finds all packages already, as where apt has brought them too.
    """
    files = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in filter(None, files.split('\0')):
        if (ROOT / name).is_file():
            (tmp_path / 'my wörk' / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / 'my wörk' / name)
    # What is compiled already, as in a checkout that was moved.
    for kernels in (ROOT / 'src').glob('**/__pycache__/*.nb[ci]'):
        copy = tmp_path / 'my wörk' / kernels.relative_to(ROOT)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(kernels, copy)
    prefix = tmp_path / 'opt' / 'ros' / 'jazzy'
    prefix.mkdir(parents=True)
    wheels = Path(sys.prefix)
    site = next(wheels.glob('lib/python3*/site-packages'))
    (prefix / 'setup.bash').write_text(
        f'export ROS_DISTRO=jazzy AMENT_PREFIX_PATH={wheels} PYTHONPATH={site}\n'
        f'export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 LD_LIBRARY_PATH={wheels}/lib:'
        + ':'.join(str(libraries) for libraries in site.glob('ros_*.libs'))
        + '\n'
    )
    dropped = ('AMENT_', 'COLCON_', 'PYTHONPATH', 'ROS_DISTRO', '_ROS_WHEELS', 'LD_LIBRARY')
    environment = {k: v for k, v in os.environ.items() if not k.startswith(dropped)}
    environment |= {
        'DVS_ROS_PREFIX': str(prefix),
        'PYTHON': sys._base_executable,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    if packages == 'there':
        environment['PYTHONPATH'] = str(site)
    repo = tmp_path / 'my wörk'
    setup = subprocess.run(
        [repo / 'scripts' / 'setup.sh'],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert setup.returncode == 0, setup.stderr
    assert f'ROS 2 Jazzy: from apt, {prefix}' in setup.stdout
    assert not list((repo / '.venv').glob('lib/python3*/site-packages/rclpy'))

    command = ['dvs_closed_loop', 'closed_loop', '--params-file', CONFIG / 'mirror_r3.yaml']
    command += ['--duration', '0.3', '--output', tmp_path / 'out']
    run = subprocess.run(
        [repo / 'scripts' / 'run.sh', *command], env=environment, capture_output=True, text=True
    )
    assert 'cycles/s' in run.stdout, run.stdout + run.stderr
    assert (tmp_path / 'out' / 'mirror_r3' / 'result.json').is_file()
