"""Nodes ask and announce themselves often; what a user has set for the middleware stays."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from dvs_common.node import middleware_periods
from dvs_common.node.middleware_periods import PROFILES, shorten_periods

FOLDER = Path(middleware_periods.__file__).parent
# A reader answers when it is asked, which by itself is 3 s after the message.
TALK = """
import sys
import rclpy
from rclpy.duration import Duration
from std_msgs.msg import String
from dvs_common.node.session import ros_session
with ros_session() as session:
    node = session.add(rclpy.create_node(sys.argv[1]))
    if sys.argv[1] == 'reader':
        node.create_subscription(String, 'words', print, 10)
        while not session.ended:
            session.turn()
    else:
        publisher = node.create_publisher(String, 'words', 10)
        while not publisher.get_subscription_count():
            session.turn()
        publisher.publish(String(data='last'))
        assert publisher.wait_for_all_acked(Duration(seconds=2))
"""


@pytest.fixture(autouse=True)
def plain(monkeypatch, tmp_path):
    """An empty folder, and none of the variables that name profiles."""
    monkeypatch.chdir(tmp_path)
    for name in (PROFILES, 'RMW_IMPLEMENTATION'):
        monkeypatch.setenv(name, '')
        monkeypatch.delenv(name)
    yield monkeypatch
    os.environ.pop(PROFILES, None)


def periods_s(path):
    """Of the questions of a writer, and of the announcements of a participant."""
    profiles = ElementTree.parse(path).getroot()
    entries = (
        'publisher[@is_default_profile="true"]/times/heartbeatPeriod',
        'participant[@is_default_profile="true"]/rtps/builtin/discovery_config/leaseAnnouncement',
    )
    space = {'': 'http://www.eprosima.com'}
    found = [profiles.find(entry, space) for entry in entries]
    return [
        float(e.findtext('sec', '0', space)) + float(e.findtext('nanosec', '0', space)) / 1e9
        for e in found
    ]


def test_periods_are_short_by_udp_alone_too():
    shorten_periods()

    assert Path(os.environ[PROFILES]).parent == FOLDER
    assert [periods_s(path) for path in sorted(FOLDER.glob('*.xml'))] == [[0.1, 0.3]] * 2
    assert periods_s(os.environ[PROFILES]) == [0.1, 0.3]


@pytest.mark.processes
def test_a_node_goes_on_to_announce_itself_often(domain):
    """As its announcements come at the port of a participant that would start as the sixth."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port,
        subprocess.Popen(
            [sys.executable, '-c', TALK, 'reader'],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stdout=subprocess.DEVNULL,
        ) as reader,
    ):
        port.bind(('127.0.0.1', 7400 + 250 * domain + 10 + 2 * 5))
        port.settimeout(20)
        announced_at = []
        for _ in range(12):
            assert port.recv(1 << 16).startswith(b'RTPS')
            announced_at.append(time.monotonic())
        reader.terminate()

    # The first six come within half a second in any case; the others would take 18 s.
    assert announced_at[-1] - announced_at[5] < 9


@pytest.mark.parametrize(
    ('name', 'value'),
    [(PROFILES, '/my/profiles.xml'), ('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp')],
)
def test_a_middleware_that_the_user_has_set_up_stays(plain, name, value):
    plain.setenv(name, value)
    before = dict(os.environ)

    shorten_periods()

    assert dict(os.environ) == before


def test_profiles_in_the_working_directory_stay_alone(tmp_path):
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()

    shorten_periods()

    assert PROFILES not in os.environ


@pytest.mark.processes
def test_a_writer_knows_soon_that_its_last_message_has_arrived(domain):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    talk = [sys.executable, '-c', TALK]
    with subprocess.Popen([*talk, 'reader'], env=environment, stdout=subprocess.DEVNULL) as reader:
        writer = subprocess.run(
            [*talk, 'writer'], env=environment, capture_output=True, text=True, timeout=60
        )
        reader.terminate()

    assert writer.returncode == 0, writer.stderr
