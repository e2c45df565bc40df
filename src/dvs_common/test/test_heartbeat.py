"""Writers ask their readers often, and what a user has set for the middleware stays."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from dvs_common.node import heartbeat
from dvs_common.node.heartbeat import PROFILES, ask_readers_often

FOLDER = Path(heartbeat.__file__).parent
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


def period_s(path):
    space = {'dds': 'http://www.eprosima.com'}
    entry = ElementTree.parse(path).find(
        'dds:publisher[@is_default_profile="true"]/dds:times/dds:heartbeatPeriod', space
    )
    return float(entry.findtext('dds:nanosec', None, space)) / 1e9


def test_writers_ask_ten_times_a_second_by_udp_alone_too():
    ask_readers_often()

    assert Path(os.environ[PROFILES]).parent == FOLDER
    assert [period_s(path) for path in sorted(FOLDER.glob('*.xml'))] == [0.1, 0.1]
    assert period_s(os.environ[PROFILES]) == 0.1


@pytest.mark.parametrize(
    ('name', 'value'),
    [(PROFILES, '/my/profiles.xml'), ('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp')],
)
def test_a_middleware_that_the_user_has_set_up_stays(plain, name, value):
    plain.setenv(name, value)
    before = dict(os.environ)

    ask_readers_often()

    assert dict(os.environ) == before


def test_profiles_in_the_working_directory_stay_alone(tmp_path):
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()

    ask_readers_often()

    assert PROFILES not in os.environ


def test_a_writer_knows_soon_that_its_last_message_has_arrived(domain):
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    talk = [sys.executable, '-c', TALK]
    with subprocess.Popen([*talk, 'reader'], env=environment, stdout=subprocess.DEVNULL) as reader:
        writer = subprocess.run(
            [*talk, 'writer'], env=environment, capture_output=True, text=True, timeout=60
        )
        reader.terminate()

    assert writer.returncode == 0, writer.stderr
