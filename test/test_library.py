"""docs/library.md holds: what the cores export, without ROS and without colcon."""

from __future__ import annotations

import doctest
import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CORES = (
    'dvs_common',
    'dvs_plant_sim',
    'dvs_event_camera',
    'dvs_hinf_controller',
    'dvs_simulation',
)
ROS = ('rclpy', 'rcl_interfaces', 'sensor_msgs', 'std_msgs', 'launch', 'ament_index_python')
EXTRAS = ('numba', 'matplotlib', 'control', 'distributed', 'PIL', 'rosbags', 'cv2')
# Imports of these fail as if they were not installed.
BLOCK = """
import sys
sys.modules.update(dict.fromkeys({absent}))
"""
USE_EVERYTHING = """
import importlib
for package in {cores}:
    module = importlib.import_module(package)
    assert package in module.__file__ and {folder!r} in module.__file__, module.__file__
    for name in module.__all__:
        getattr(module, name)
from dvs_common import Scenario
from dvs_hinf_controller import design_from_scenario
from dvs_simulation import ClosedLoop, run_sampled, simulate
scenario = Scenario.from_values({{}})
loop = ClosedLoop.from_scenario(scenario, design_from_scenario(scenario).controller)
print(simulate(loop, duration=1.0).event_count)
"""
IMPORT_ALL = """
import importlib, pkgutil
for package in {cores}:
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + '.'):
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            print(module.name, error.name.partition('.')[0])
"""


@pytest.fixture(scope='module')
def installed(tmp_path_factory):
    """Folder into which pip has installed the cores from their source folders."""
    folder = tmp_path_factory.mktemp('library')
    for core in CORES:
        shutil.copytree(ROOT / 'src' / core, folder / 'src' / core)
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '-q', '--no-deps', '--no-build-isolation']
        + ['--target', folder / 'site', *(folder / 'src' / core for core in CORES)],
        check=True,
        capture_output=True,
    )
    return folder / 'site'


def python(text: str, folder: Path, interpreter: str = sys.executable) -> str:
    """Run a program that sees the folder and neither colcon's install nor the sources."""
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONPATH'}
    done = subprocess.run(
        [interpreter, '-c', text],
        cwd='/',
        env={**environment, 'PYTHONPATH': str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def exact_events() -> int:
    from dvs_common import Scenario
    from dvs_hinf_controller import design_from_scenario
    from dvs_simulation import ClosedLoop, simulate

    scenario = Scenario.from_values({})
    loop = ClosedLoop.from_scenario(scenario, design_from_scenario(scenario).controller)
    return simulate(loop, duration=1.0).event_count


@pytest.mark.parametrize('package', CORES)
def test_a_package_exports_what_it_names_and_no_module_hides_a_name(package):
    module = importlib.import_module(package)
    exported = {name: getattr(module, name) for name in module.__all__}

    assert all(not isinstance(value, type(sys)) for value in exported.values())
    with pytest.raises(AttributeError, match='nothing_like_it'):
        _ = module.nothing_like_it


@pytest.mark.parametrize('package', CORES)
def test_the_examples_of_a_package_are_true(package):
    module = importlib.import_module(package)
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    result = doctest.testmod(module, optionflags=flags)

    assert result.attempted > 3
    assert result.failed == 0


def test_importing_a_package_imports_nothing_heavy():
    heavy = (*ROS, *EXTRAS, 'scipy', 'numpy')
    imports = '\n'.join(f'import {core}' for core in CORES)
    paths = os.pathsep.join(str(ROOT / 'src' / core) for core in CORES)

    python(f'import sys\n{imports}\nassert not set(sys.modules) & set({heavy})', paths)


def test_the_nodes_of_a_loop_import_nothing_that_only_some_scenarios_need():
    heavy = (
        *('numba', 'control', 'matplotlib', 'pandas', 'dask', 'jinja2', 'rosbags', 'cv2', 'PIL'),
        *('scipy.optimize', 'scipy.special', 'scipy.signal', 'scipy.sparse', 'scipy.integrate'),
    )
    nodes = (
        'dvs_plant_sim.plant_sim_node',
        'dvs_event_camera.event_camera_node',
        'dvs_hinf_controller.hinf_controller_node',
    )
    imports = '\n'.join(f'import {node}' for node in nodes)
    paths = os.pathsep.join(str(ROOT / 'src' / core) for core in CORES)

    python(f'import sys\n{imports}\nassert not set(sys.modules) & set({heavy})', paths)


def test_the_page_of_the_library_is_not_stale():
    check = subprocess.run(
        [sys.executable, ROOT / 'scripts' / 'library_doc.py', '--check'],
        capture_output=True,
        text=True,
    )

    assert check.returncode == 0, check.stderr


@pytest.mark.parametrize('core', CORES)
def test_what_is_exported_is_taught_by_that_name(core):
    exported = importlib.import_module(core).__all__
    pages = [ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')]
    pages += (ROOT / 'examples').glob('**/*.py')
    pages += (ROOT / 'examples').glob('**/*.ipynb')
    deep = {
        (page.name, name)
        for page in pages
        for names in re.findall(rf'from {core}\.[\w.]+ import ([\w, ]+)', page.read_text())
        for name in names.split(', ')
    }

    assert not [(page, name) for page, name in deep if name in exported]


def test_cores_installed_by_pip_simulate_without_ros_and_without_extras(installed):
    absent = BLOCK.format(absent=(*ROS, *EXTRAS))
    use = USE_EVERYTHING.format(cores=CORES, folder=str(installed))

    assert int(python(absent + use, installed)) == exact_events()


def test_all_modules_but_the_nodes_import_without_ros(installed):
    output = python(BLOCK.format(absent=ROS) + IMPORT_ALL.format(cores=CORES), installed)
    failed = dict(line.split() for line in output.splitlines())

    assert set(failed.values()) <= set(ROS)
    assert [name for name in failed if '.node.' not in name and not name.endswith('_node')] == [
        'dvs_plant_sim.lockstep_driver',
        'dvs_plant_sim.realtime_driver',
    ]


def test_a_core_names_the_folders_of_those_below_it_which_no_index_has(installed):
    (metadata,) = installed.glob('dvs_simulation-*.dist-info/METADATA')
    needs = re.findall(r'(?m)^Requires-Dist: (dvs[-\w]+) @ (\S+)$', metadata.read_text())

    sources = installed.parent / 'src'
    assert {name.replace('-', '_'): folder for name, folder in needs} == {
        core: f'file://localhost{sources / core}' for core in CORES if core != 'dvs_simulation'
    }


@pytest.mark.long
def test_pip_alone_brings_everything_that_the_cores_need(tmp_path):
    for core in CORES:
        shutil.copytree(ROOT / 'src' / core, tmp_path / core)
    subprocess.run([sys.executable, '-m', 'venv', tmp_path / 'venv'], check=True)
    interpreter = str(tmp_path / 'venv' / 'bin' / 'python')
    subprocess.run(
        [interpreter, '-m', 'pip', 'install', '-q', tmp_path / 'dvs_simulation'],
        check=True,
    )
    use = USE_EVERYTHING.format(cores=CORES, folder=str(tmp_path))

    assert int(python(use, tmp_path / 'nowhere', interpreter)) == exact_events()
    with pytest.raises(AssertionError, match='rclpy'):
        python('import rclpy', tmp_path / 'nowhere', interpreter)
