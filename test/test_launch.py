"""The launch files: installed where `ros2 launch` looks, and run where launch is installed."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from loop_support import CONFIG, environment

LAUNCH_FILES = {
    'dvs_plant_sim': ('plant_sim', 'pendulum_sim'),
    'dvs_event_camera': ('event_camera',),
    'dvs_hinf_controller': ('hinf_controller',),
    'dvs_closed_loop': ('closed_loop',),
}
ALL = [(package, name) for package, names in LAUNCH_FILES.items() for name in names]
RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
service = LaunchService()
arguments = [tuple(word.split(':=', 1)) for word in sys.argv[2:]]
source = PythonLaunchDescriptionSource(sys.argv[1])
included = IncludeLaunchDescription(source, launch_arguments=arguments)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


def launch_file(package, name):
    return Path(get_package_share_directory(package)) / 'launch' / f'{name}.launch.py'


def start_launch(package, name, domain, *arguments):
    pytest.importorskip('launch_ros', reason='launch comes with ROS 2 from apt only')
    return subprocess.Popen(
        [sys.executable, '-c', RUN, str(launch_file(package, name)), *arguments],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@pytest.mark.parametrize(('package', 'name'), ALL)
def test_it_is_installed_and_describes_a_launch(package, name):
    tree = ast.parse(launch_file(package, name).read_text())
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert 'generate_launch_description' in functions


@pytest.mark.parametrize(('package', 'name'), ALL)
def test_every_executable_has_its_launch_file(package, name):
    assert os.access(
        Path(get_package_share_directory(package)) / f'../../lib/{package}/{name}', os.X_OK
    )


def test_a_launched_loop_ends_with_its_run(domain, processes, tmp_path):
    short = tmp_path / 'short.yaml'
    text = (CONFIG / 'pendulum.yaml').read_text()
    short.write_text(text.replace('duration: 6.0', 'duration: 0.3'))
    process = start_launch(
        *('dvs_closed_loop', 'closed_loop', domain),
        *(f'scenario:={short}', 'namespace:=left', 'method:=structured'),
    )
    processes.append(process)
    output, _ = process.communicate(timeout=90)

    assert process.returncode == 0, output
    assert 'left.plant_sim]: run of 0.3 s finished' in output
    assert 'structured controller, designed' in output
    assert 'Traceback' not in output


def test_a_launched_node_gets_its_parameter_file(domain, processes, tmp_path):
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text('/**:\n  ros__parameters:\n    event_threshold: -1.0\n')
    process = start_launch(
        *('dvs_event_camera', 'event_camera', domain), f'params_file:={wrong}', 'namespace:=left'
    )
    processes.append(process)
    output, _ = process.communicate(timeout=60)

    assert 'cannot start: event_threshold = -1.0: must be a finite double > 0' in output
    assert 'Traceback' not in output


def test_a_bad_argument_is_one_line(domain, processes):
    process = start_launch('dvs_closed_loop', 'closed_loop', domain, 'scenario:=nowhere')
    processes.append(process)
    output, _ = process.communicate(timeout=30)

    assert process.returncode == 1
    assert 'scenario = nowhere: must be a parameter file or one of' in output
    assert 'Traceback' not in output
