"""The message type that is made up where event_camera_msgs is not installed, against the real."""

import json
import os
import shutil
import subprocess
import sys

import generated_messages
import pytest
from sensor_encoders import mono_words, packet_message, some_events

pytest.importorskip('rclpy')
pytest.importorskip('rosidl_generator_type_description')

from sensor_msgs.msg import PointCloud2

from dvs_common.wire import topics
from dvs_common.wire.events import parse_events
from dvs_event_camera.streams.event_packet import DEFINITION
from dvs_event_camera.tools import packet_type

pytestmark = pytest.mark.skipif(
    generated_messages.prefix() is None, reason='no ROS with descriptions of its messages'
)

# Publishes three packets by the generated class, and prints one that it receives.
DRIVER = """
import sys, time
import rclpy
from event_camera_msgs.msg import EventPacket
from rclpy.qos import QoSProfile

rclpy.init()
node = rclpy.create_node('driver')
publisher = node.create_publisher(EventPacket, 'events_packet', 100)
end = time.monotonic() + 30
while not publisher.get_subscription_count() and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.05)
for k in range(3):
    packet = EventPacket(width=640, height=480, encoding='mono', seq=k, time_base=10**18 + k)
    packet.header.stamp.sec, packet.header.stamp.nanosec = 10**9, 1000 * k
    packet.events.frombytes((1 << 63 | 5 << 48 | 7 << 32 | 10).to_bytes(8, 'little'))
    publisher.publish(packet)
arrived = []
node.create_subscription(EventPacket, 'borrowed', arrived.append, 10)
while not arrived and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.05)
got = arrived[0]
print(got.width, got.height, got.seq, got.time_base, got.encoding, len(got.events), flush=True)
"""


def test_the_hash_is_that_of_the_true_message(tmp_path):
    description = json.loads(generated_messages.described(tmp_path).read_text())

    (own, *_) = description['type_hashes']
    assert own['type_name'] == 'event_camera_msgs/msg/EventPacket'
    assert own['hash_string'] == f'RIHS01_{packet_type._HASH.hex()}'
    fields = description['type_description_msg']['type_description']['fields']
    assert [field['name'] for field in fields] == [
        name.decode() for name, _ in packet_type._FIELDS
    ]
    assert DEFINITION.split() == generated_messages.MESSAGE.split()


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.skipif(shutil.which('g++') is None, reason='no compiler')
def test_messages_pass_between_the_borrowed_type_and_the_generated_one(graph, tmp_path):
    generated_messages.described(tmp_path)
    python, libraries = generated_messages.compiled(tmp_path)
    places = os.pathsep.join([str(python), *(path for path in sys.path if path)])
    loaded = os.pathsep.join([str(libraries), os.environ.get('LD_LIBRARY_PATH', '')])
    graph.start('tools.packet_bridge_node')
    received = graph.collect(PointCloud2, 'events', topics.stream_qos())
    kind = packet_type.event_packet_type()
    assert kind.__module__ == packet_type.__name__
    publisher = graph.node.create_publisher(kind, 'borrowed', 10)
    graph.turn_until(lambda: graph.node.count_publishers('events') > 0)
    graph.turn_for(1.0)
    environment = {
        **os.environ,
        'PYTHONPATH': places,
        'LD_LIBRARY_PATH': loaded,
        'ROS_DOMAIN_ID': str(graph._domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    driver = subprocess.Popen(
        [sys.executable, '-c', DRIVER],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    events = some_events(5)
    message = packet_message(mono_words(events, 0), 'mono', width=640, height=480)
    try:
        graph.turn_until(lambda: len(received) == 3)
        graph.turn_until(lambda: driver.poll() is not None, act=lambda: publisher.publish(message))
        out, err = driver.communicate(timeout=10)
    finally:
        driver.kill()

    assert [parse_events(bytes(one)).events['x'].tolist() for one in received] == [[7]] * 3
    assert out.split()[:2] == ['640', '480'], err
    assert out.split()[4:] == ['mono', '40']
