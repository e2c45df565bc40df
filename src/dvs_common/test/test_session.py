"""ROS is entered in one way: what is set around it is checked before."""

import os
import signal
import subprocess
import sys

import pytest
import rclpy

from dvs_common.errors import ParameterError
from dvs_common.node.session import (
    own_arguments,
    require_discovery,
    require_domain,
    ros_session,
)
from dvs_common.program import ENDING


@pytest.mark.parametrize('text', ['', ' 7 ', '0', '232', '0x10', '017', '+3'])
def test_a_domain_of_ros_is_taken_as_ros_reads_it(text, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', text)

    require_domain()


@pytest.mark.parametrize('text', ['233', '500', '-1', 'abc', '1.5', '0x', '1 2', '99999999999'])
def test_a_domain_that_is_none_is_refused(text, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', text)

    with pytest.raises(ParameterError, match=r'must be a whole number from 0 to 232'):
        require_domain()


@pytest.mark.parametrize('text', ['OFF', 'off'])
def test_a_loop_whose_nodes_can_not_find_each_other_is_refused(text, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', text)

    with pytest.raises(ParameterError, match='lets no node find another'):
        require_discovery()


@pytest.mark.parametrize(
    'variables',
    [
        {'ROS_LOG_DIR': '/proc/no/such/folder'},
        {'ROS_HOME': '/proc/no/such/folder'},
        {'HOME': '/proc/no/such/folder'},
        {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'},
        {'ROS_STATIC_PEERS': 'no.such.host.invalid'},
        {'RCUTILS_COLORIZED_OUTPUT': 'maybe'},
        {'RCUTILS_LOGGING_USE_STDOUT': 'true'},
        {'RCUTILS_LOGGING_BUFFERED_STREAM': '2'},
    ],
    ids=lambda variables: next(iter(variables)),
)
def test_the_variable_that_keeps_ros_from_starting_is_named(variables):
    code = (
        'import rclpy\n'
        'from dvs_common.errors import ParameterError\n'
        'from dvs_common.node.session import ros_session\n'
        'try:\n    with ros_session() as session: session.add(rclpy.create_node("n"))\n'
        'except ParameterError as error: print(error)\n'
    )
    outside = {k: v for k, v in os.environ.items() if not k.startswith(('ROS_LO', 'ROS_HO'))}
    found = subprocess.run(
        [sys.executable, '-c', code], env=outside | variables, capture_output=True, text=True
    )

    name, value = next(iter(variables.items()))
    assert found.stdout.startswith(f'{name} = {value}: '), found.stderr


def test_arguments_that_ros_refuses_are_named():
    with pytest.raises(ParameterError, match='ros-args = -p: Failed to parse'):
        own_arguments(['program', '--ros-args', '-p', ''])


def test_a_namespace_that_the_middleware_refuses_is_reported():
    arguments = ['program', '--ros-args', '-r', f'__ns:=/{"a" * 300}']

    with (
        pytest.raises(ParameterError, match=r'ros-args = -r __ns:=/a+.*invalid node namespace'),
        ros_session(arguments) as session,
    ):
        session.add(rclpy.create_node('n'))


def test_a_session_ends_ros_even_after_an_error():
    with pytest.raises(ZeroDivisionError), ros_session():
        raise ZeroDivisionError
    with ros_session() as session:
        assert not session.ended


def test_after_a_session_signals_are_handled_as_before():
    before = [signal.getsignal(number) for number in ENDING]
    with ros_session() as session:
        signal.raise_signal(signal.SIGINT)
        assert session.ended

    assert [signal.getsignal(number) for number in ENDING] == before
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_second_signal_does_not_interrupt_what_a_program_does_after_its_session(tmp_path):
    program = tmp_path / 'late.py'
    program.write_text(LATE)
    run = 'from dvs_common.program import run_program; raise SystemExit(run_program("late"))'
    found = subprocess.run(
        [sys.executable, '-c', run], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )

    assert (found.returncode, found.stdout, found.stderr) == (0, 'written\n', '')


# As Fast DDS does at the end, with Python's lock and all signals ignored.
STUCK = """
import atexit, ctypes, sys

def main():
    from dvs_common.node.session import ros_session
    atexit.register(ctypes.PyDLL(None).pause)
    return 3
"""


RUNS = {
    'from dvs_common.program import run_program; sys.exit(run_program("stuck"))': 3,
    'from dvs_common.node.spin import run_nodes; stuck.main(); '
    'sys.exit(run_nodes([], ["stuck", "--help"]))': 0,
}


@pytest.mark.processes
@pytest.mark.parametrize(('run', 'code'), list(RUNS.items()), ids=['program', 'nodes'])
def test_a_program_ends_with_its_code_where_the_middleware_waits_for_ever(run, code, tmp_path):
    (tmp_path / 'stuck.py').write_text(STUCK)
    process = subprocess.Popen([sys.executable, '-c', f'import sys, stuck; {run}'], cwd=tmp_path)
    try:
        assert process.wait(timeout=30) == code
    finally:
        process.kill()


@pytest.mark.processes
@pytest.mark.parametrize(('runner', 'left'), [('program', True), ('notebook', False)])
def test_a_participant_is_deleted_at_the_end_of_a_program_and_of_any_other_session(
    runner, left, tmp_path
):
    (tmp_path / 'leaves.py').write_text(LEAVES)
    run = {
        'program': 'from dvs_common.program import run_program; run_program("leaves")',
        'notebook': 'import leaves; leaves.main()',
    }[runner]
    found = subprocess.run(
        [sys.executable, '-c', run], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )

    assert found.stderr == ''
    assert (int(found.stdout) > 0) == left


LEAVES = """
from pathlib import Path
import rclpy
from dvs_common.node.session import ros_session

def receivers():
    names = (path.read_text() for path in Path('/proc/self/task').glob('*/comm'))
    return sum(name.startswith('dds.udp') for name in names)

def main():
    with ros_session() as session:
        session.add(rclpy.create_node('leaves'))
        assert receivers()
    print(receivers())
    return 0
"""
LATE = """
import signal
from dvs_common.node.session import ros_session

def main():
    with ros_session() as session:
        signal.raise_signal(signal.SIGINT)
        assert session.ended
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.raise_signal(number)
    print('written')
    return 0
"""
FIRST_LOG = """
import os
from rclpy.node import Node
from dvs_common.node.session import ros_session

asked = []
resolve = os.path.realpath
with ros_session() as session:
    node = session.add(Node('talker'))
    os.path.realpath = lambda path, **options: asked.append(path) or resolve(path, **options)
    node.get_logger().info('text')
print(len(asked))
"""


def test_the_first_log_of_a_node_does_not_look_at_every_module(tmp_path):
    talker = tmp_path / 'talker.py'
    talker.write_text(FIRST_LOG)
    found = subprocess.run([sys.executable, talker], capture_output=True, text=True, timeout=60)

    assert found.returncode == 0, found.stderr
    assert int(found.stdout) < 30


def test_what_waits_for_its_first_use_still_waits_when_ros_has_started():
    code = (
        'from dvs_common.late_imports import import_less\n'
        'import_less()\n'
        'import sys, scipy.linalg\n'
        'from dvs_common.node.session import ros_session\n'
        'with ros_session():\n'
        '    print("numpy.f2py.crackfortran" in sys.modules)\n'
    )

    found = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert found.stdout == 'False\n', found.stderr
