"""Shared memory that is full, or of another user, is left to UDP."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dvs_common.node.shared_memory import leave_shared_memory_where_needed

VARIABLES = (
    'FASTDDS_BUILTIN_TRANSPORTS',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'ROS_AUTOMATIC_DISCOVERY_RANGE',
    'ROS_LOCALHOST_ONLY',
    'RMW_IMPLEMENTATION',
)
DOMAIN = 7
OTHER_USER = 47110
as_root = pytest.mark.skipif(os.geteuid() != 0, reason='only root can be another user')

# Sends its name until it has a message of the other, at most for 20 s.
TALK = """
import sys, time
from std_msgs.msg import String
from dvs_common.node.session import ros_session
import rclpy
mine, other = sys.argv[1:]
with ros_session() as session:
    node = session.add(rclpy.create_node(mine))
    publisher = node.create_publisher(String, f'of_{mine}', 10)
    received = []
    node.create_subscription(String, f'of_{other}', received.append, 10)
    print('ready', flush=True)
    end = time.monotonic() + 20
    while not received and time.monotonic() < end:
        publisher.publish(String(data=mine))
        session.spin(0.05)
    publisher.publish(String(data=mine))
    session.spin(1.0)
sys.exit(not received)
"""


@pytest.fixture
def plain(monkeypatch):
    """None of the variables that say how messages travel; what is set in a test goes again."""
    for name in VARIABLES:
        monkeypatch.setenv(name, '')
        monkeypatch.delenv(name)
    yield monkeypatch
    for name in VARIABLES:
        os.environ.pop(name, None)


def almost_full(monkeypatch, folder):
    left = list(os.statvfs(folder))
    left[4] = 1  # f_bavail
    monkeypatch.setattr(os, 'statvfs', lambda folder: os.statvfs_result(left))


def test_a_full_shared_memory_is_left_and_one_with_room_is_not(plain, tmp_path, capsys):
    leave_shared_memory_where_needed(DOMAIN, str(tmp_path))
    assert 'FASTDDS_BUILTIN_TRANSPORTS' not in os.environ

    almost_full(plain, tmp_path)
    leave_shared_memory_where_needed(DOMAIN, str(tmp_path))
    assert os.environ['FASTDDS_BUILTIN_TRANSPORTS'] == 'UDPv4'
    assert 'kB left: messages go by UDP alone' in capsys.readouterr().err


@pytest.mark.parametrize(
    'variables',
    [{'ROS_AUTOMATIC_DISCOVERY_RANGE': 'localhost'}, {'ROS_LOCALHOST_ONLY': '1'}],
    ids=['range', 'old variable'],
)
def test_discovery_on_this_machine_stays_there_without_shared_memory(plain, tmp_path, variables):
    for name, value in variables.items():
        plain.setenv(name, value)
    almost_full(plain, tmp_path)

    leave_shared_memory_where_needed(DOMAIN, str(tmp_path))

    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SYSTEM_DEFAULT'
    assert 'ROS_LOCALHOST_ONLY' not in os.environ
    profile = Path(os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'])
    assert '<address>127.0.0.1</address>' in profile.read_text(encoding='utf-8')


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('FASTDDS_BUILTIN_TRANSPORTS', 'SHM'),
        ('FASTRTPS_DEFAULT_PROFILES_FILE', '/my/profiles.xml'),
        ('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp'),
    ],
)
def test_transports_that_the_user_has_chosen_stay(plain, tmp_path, capsys, name, value):
    plain.setenv(name, value)
    before = dict(os.environ)
    almost_full(plain, tmp_path)

    leave_shared_memory_where_needed(DOMAIN, str(tmp_path))

    assert dict(os.environ) == before
    assert capsys.readouterr().err == ''


@as_root
@pytest.mark.parametrize(
    ('port', 'owner', 'is_held', 'is_left'),
    [
        (9161, OTHER_USER, True, True),
        (9161, OTHER_USER, False, False),  # left behind by a process that was killed
        (9161, os.geteuid(), True, False),
        (9411, OTHER_USER, True, False),  # of domain 8
    ],
)
def test_a_port_that_another_user_holds_is_noticed(
    plain, tmp_path, capsys, port, owner, is_held, is_left
):
    path = tmp_path / f'fastrtps_port{port}_el'
    with path.open('w') as lock:
        os.chown(path, owner, -1)
        if is_held:
            fcntl.flock(lock, fcntl.LOCK_EX)

        leave_shared_memory_where_needed(DOMAIN, str(tmp_path))

    assert ('FASTDDS_BUILTIN_TRANSPORTS' in os.environ) == is_left
    line = f'user {OTHER_USER} has nodes in domain {DOMAIN} too: messages go by UDP alone\n'
    assert capsys.readouterr().err == line * is_left


@pytest.mark.processes
def test_nodes_of_two_users_get_each_others_messages(another_user, domain, tmp_path):
    (tmp_path / 'talk.py').write_text(TALK)
    variables = {k: v for k, v in os.environ.items() if k not in VARIABLES}
    variables |= {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': '/tmp',
    }
    talk = [sys.executable, str(tmp_path / 'talk.py')]
    with subprocess.Popen(
        [*another_user, *talk, 'first', 'second'], env=variables, stdout=subprocess.PIPE, text=True
    ) as first:
        assert first.stdout.readline() == 'ready\n'
        second = subprocess.run(
            [*talk, 'second', 'first'], env=variables, capture_output=True, text=True
        )
        assert second.returncode == 0, second.stderr
        assert f'user {OTHER_USER} has nodes in domain {domain} too' in second.stderr
        assert first.wait(30) == 0
