"""The nodes as real processes over real DDS."""

import array
import io
import itertools
import math
import re
import signal

import numpy as np
import pytest
from sensor_encoders import mono_words, packet_message

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Int16MultiArray, String

from dvs_common.wire import topics
from dvs_common.wire.anchor import parse_anchor
from dvs_common.wire.events import EventPacket, make_events, pack_events, parse_events
from dvs_common.wire.keyframe import parse_keyframe
from dvs_common.wire.messages import pack_image, parse_image
from dvs_event_camera.streams.event_packet import parse_event_packet
from dvs_event_camera.streams.packet_decoder import PacketDecoder
from dvs_event_camera.streams.sensor_events import SensorEvents
from dvs_event_camera.tools.packet_type import event_packet_type

pytestmark = pytest.mark.processes

MS = 1_000_000
CAMERA = 'event_camera_node'


def feed(graph, received, publisher, messages):
    """Publish messages one by one, each when the camera has answered the last."""
    graph.turn_until(lambda: publisher.get_subscription_count() > 0)
    for message in messages:
        before = len(received)
        publisher.publish(message)
        graph.turn_until(lambda before=before: len(received) > before)


def luminosities():
    rng = np.random.default_rng(0)
    level = np.zeros((2, 3))
    for k in range(12):
        yield pack_image(k * MS, np.exp(level), '64FC1')
        level += rng.normal(0, 0.15, (2, 3))


def test_one_packet_a_sample_and_the_same_bytes_in_every_run(graph):
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('lockstep'))
    keyframes = graph.collect(PointCloud2, 'keyframe', topics.latched_qos(1))
    anchors = graph.collect(Image, 'anchor', topics.stream_qos())
    publisher = graph.node.create_publisher(Image, 'luminosity', topics.stream_qos())
    runs = []
    for _ in range(2):
        camera = graph.start(CAMERA, event_threshold=0.1, keyframe_period=0.005, frame_rate=200.0)
        received.clear()
        messages = list(luminosities())
        feed(graph, received, publisher, messages)
        publisher.publish(messages[-1])  # sent again: the same answer
        graph.turn_until(lambda: len(received) > 12)
        code, _, err = camera.stop()
        assert code == 0, err
        assert 'Traceback' not in err
        assert bytes(received[-1]) == bytes(received[-2])
        runs.append([bytes(message) for message in received[:-1]])
        graph.turn_until(lambda: publisher.get_subscription_count() == 0)
    assert runs[0] == runs[1]
    packets = [parse_events(message) for message in runs[0]]
    assert [packet.stamp_ns for packet in packets] == [k * MS for k in range(12)]
    events = np.concatenate([packet.events for packet in packets])
    assert events['index'].tolist() == list(range(len(events)))
    net = np.zeros((2, 3), int)
    np.add.at(net, (events['y'], events['x']), events['polarity'])
    last = parse_image(bytes(messages[-1]))
    change = np.log(np.frombuffer(last.data, '<f8').reshape(2, 3))
    assert np.all(np.abs(change - net * 0.1) < 0.1 + 1e-9)
    measured = [parse_anchor(bytes(message)) for message in anchors]
    assert [anchor.stamp_ns for anchor in measured[:3]] == [0, 5 * MS, 10 * MS]
    for anchor, number in zip(measured[:3], (0, 5, 10), strict=True):
        seen = np.frombuffer(parse_image(bytes(messages[number])).data, '<f8')
        np.testing.assert_allclose(anchor.luminosity, seen, rtol=1e-6)
    frames = [parse_keyframe(bytes(message)) for message in keyframes]
    assert [frame.stamp_ns for frame in frames[:3]] == [0, 5 * MS, 10 * MS]
    assert frames[0].epoch == frames[2].epoch != frames[-1].epoch
    assert [frames[0].age_s, frames[2].age_s] == [0, 0.01]
    assert np.all((frames[0].lower < 1) & (frames[0].upper > 1))
    until = np.concatenate([packet.events for packet in packets[:11]])
    sums = np.zeros((2, 3), int)
    np.add.at(sums, (until['y'], until['x']), until['polarity'])
    assert np.array_equal(frames[2].counts.reshape(2, 3), sums)
    assert frames[2].events == frames[2].next_index == len(until)


def test_subscribers_get_pictures_sums_and_packets_and_a_restart_is_reported(graph):
    camera = graph.start(
        CAMERA, stub=True, event_threshold=0.3, display_rate=1000.0, label_noise='true'
    )
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('lockstep'))
    publisher = graph.node.create_publisher(Image, 'luminosity', topics.stream_qos())
    grey = np.full((4, 5), 100, np.uint8)
    feed(graph, received, publisher, [pack_image(0, grey, 'mono8')])
    pictures = graph.collect(Image, 'event_image', topics.stream_qos())
    sums = graph.collect(Int16MultiArray, 'polarity', topics.stream_qos(), raw=False)
    packets = graph.collect(String, 'events_packet', topics.stream_qos())
    labels = graph.collect(PointCloud2, 'events_label', topics.stream_qos())
    clouds = graph.collect(PointCloud2, 'event_cloud', topics.stream_qos(), raw=False)
    diagnostics = graph.collect(DiagnosticArray, '/diagnostics', topics.stream_qos(), raw=False)
    stamp = 0

    def brighter():
        nonlocal stamp
        if parse_events(bytes(received[-1])).stamp_ns < stamp:
            return  # a source that outruns its consumers loses frames
        stamp += MS
        grey[1, 2] = 100 if grey[1, 2] == 200 else 200
        publisher.publish(pack_image(stamp, grey, 'mono8'))

    graph.turn_until(
        lambda: len(pictures) > 3 and sums and packets and labels and clouds, act=brighter
    )
    picture = parse_image(bytes(pictures[-1]))
    assert (picture.format.encoding, picture.format.height, picture.format.width) == ('bgr8', 4, 5)
    lit = np.frombuffer(picture.data, np.uint8).reshape(4, 5, 3)
    assert np.argwhere(np.ptp(lit.astype(int), axis=2) > 60).tolist() == [[1, 2]]
    assert [dim.size for dim in sums[-1].layout.dim] == [4, 5]
    assert np.flatnonzero(sums[-1].data).tolist() == [7]
    points = np.frombuffer(clouds[-1].data, '<f4').reshape(-1, 3)
    assert {tuple(point) for point in points[:, :2]} == {(2.0, 1.0)}
    packet = PacketDecoder().decode(parse_event_packet(bytes(packets[-1])))
    assert set(zip(packet.x, packet.y, strict=True)) == {(2, 1)}
    assert 'noise' in parse_events(bytes(labels[-1])).events.dtype.names

    # Junk is refused, another size starts the sensor again, and both are logged.
    publisher.publish(pack_image(stamp + MS, np.zeros((4, 5, 2), np.uint8), 'yuv420'))
    publisher.publish(b'\x00\x01\x00\x00 rubbish')
    publisher.publish(pack_image(stamp + MS, np.full((2, 2), 50, np.uint8), 'mono8'))

    def is_reported():
        values = {v.key: v.value for m in diagnostics for s in m.status for v in s.values}
        return values.get('restarts') == '1' and values.get('messages refused') == '2'

    graph.turn_until(is_reported)
    code, _, err = camera.stop(signal.SIGTERM)
    assert code == 0, err
    assert 'from 4 x 5 to 2 x 2' in err
    assert 'yuv420' in err
    assert 'Traceback' not in err


def test_start_that_violates_a1_ends_with_one_clear_message(graph):
    camera = graph.start(CAMERA, reference_uncertainty=0.5)
    publisher = graph.node.create_publisher(Image, 'luminosity', topics.stream_qos())
    graph.turn_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(pack_image(0, np.array([[10.0, 1.0]]), '64FC1'))
    code, _, err = camera.wait()
    assert code == 2, err
    assert 'pixel 1' in err
    assert 'Traceback' not in err


def test_wrong_combination_ends_with_one_clear_message(graph):
    code, _, err = graph.start(CAMERA, photoreceptor='signed_log', jitter=0.001).wait()
    assert code == 2, err
    assert 'no real sensor' in err
    assert 'Traceback' not in err


def test_scene_to_camera_to_table(graph, tmp_path):
    table = tmp_path / 'events.csv'
    camera = graph.start(CAMERA, mode='realtime', event_threshold=0.2)
    show = graph.start('tools.show_events', '--csv', str(table), '--limit', '500')
    scene = graph.start('tools.scene_node', 'grating', '--size', '8x16', '--period', '8')
    code, _, err = show.wait()
    assert code == 0, err
    assert re.search(r'\d packets, \d+ events in \d', err) or 'no packet received' in err
    assert scene.stop()[0] == 0
    assert camera.stop()[0] == 0
    columns = np.loadtxt(table, delimiter=',', skiprows=1, dtype=np.int64)
    assert columns.shape == (500, 5)
    assert columns[:, 1].max() <= 15
    assert columns[:, 2].max() <= 7
    assert np.all(np.diff(columns[:, 0]) >= 0)
    assert set(columns[:, 3]) == {0, 1}


def test_scene_waits_for_subscribers_so_that_its_first_picture_is_not_lost(graph):
    scene = graph.start('tools.scene_node', 'grating', '--size', '2x3', '--frames', '5')
    graph.turn_until(lambda: graph.node.count_publishers('luminosity') > 0)
    graph.turn_for(0.5)
    seen = graph.collect(Image, 'luminosity', topics.stream_qos())
    code, _, err = scene.wait()
    graph.turn_until(lambda: len(seen) == 5)
    assert code == 0, err


def test_scene_begins_at_once_with_no_wait(graph):
    code, _, err = graph.start('tools.scene_node', '--frames', '3', '--no-wait').wait()
    assert code == 0, err


def driver_packet(sequence, x, y, stamp_ns, t_ns=None):
    """A `mono` packet of a driver with one event a given pixel."""
    events = SensorEvents(
        t=np.arange(len(x)) + (stamp_ns if t_ns is None else t_ns),
        x=np.array(x, np.uint16),
        y=np.array(y, np.uint16),
        p=np.ones(len(x), np.uint8),
    )
    base = int(events.t[0])
    return packet_message(
        mono_words(events, base),
        'mono',
        stamp_ns=stamp_ns,
        sequence=sequence,
        time_base=base,
        width=640,
        height=480,
    )


def test_bridge_takes_a_drivers_packets_and_sends_the_pixels_of_the_loop(graph):
    bridge = graph.start(
        'tools.packet_bridge_node',
        region='[100, 200, 6, 4]',
        binning=2,
        masked_pixels='[101, 201]',
    )
    received = graph.collect(PointCloud2, 'events', topics.stream_qos())
    # Found by the same class that is used where event_camera_msgs is not installed.
    kind = event_packet_type()
    publisher = graph.node.create_publisher(kind, 'events_packet', topics.stream_qos())
    graph.turn_until(lambda: publisher.get_subscription_count() > 0)
    graph.turn_until(lambda: graph.node.count_publishers('events') > 0)
    graph.turn_for(1.0)
    publisher.publish(b'\x00\x01\x00\x00 rubbish')
    for sequence in (0, 1, 5):
        stamp = 10**18 + sequence * MS
        # Left of the region, its first pixel, a masked one, its last one.
        publisher.publish(
            driver_packet(sequence, [99, 100, 101, 105], [200, 200, 201, 203], stamp)
        )
    graph.turn_until(lambda: len(received) == 3)
    packets = [parse_events(bytes(message)) for message in received]
    assert [packet.stamp_ns - 10**18 for packet in packets] == [3, MS + 3, 5 * MS + 3]
    index = np.concatenate([packet.events['index'] for packet in packets])
    assert index.tolist() == [0, 1, 2, 3, 5, 6]  # the loss before number 5 is a gap
    assert packets[0].events['x'].tolist() == [0, 2]
    assert packets[0].events['y'].tolist() == [0, 1]
    code, _, err = bridge.stop()
    assert code == 0, err
    assert '3 packets lost' in err
    assert 'message refused' in err
    assert 'Traceback' not in err


def test_bridge_refuses_a_region_that_is_none(graph):
    code, _, err = graph.start('tools.packet_bridge_node', region='[0, 0, 5]').wait()
    assert code == 2, err
    assert 'region = [0, 0, 5]' in err
    assert 'Traceback' not in err


@pytest.mark.parametrize(
    'arguments', [['--size', 'big'], ['no_such_scene'], ['--rate', '0'], ['--frames', '-1']]
)
def test_scene_refuses_what_makes_no_sense(graph, arguments):
    code, _, err = graph.start('tools.scene_node', *arguments).wait()
    assert code == 2, err
    assert err.startswith('cannot start: ')
    assert 'Traceback' not in err


def test_black_pixels_of_a_float_image_hold_and_are_logged_once(graph):
    camera = graph.start(CAMERA, event_threshold=0.1)
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('lockstep'))
    publisher = graph.node.create_publisher(Image, 'luminosity', topics.stream_qos())
    frames = [[1.0, 1.0], [-1.0, 1.0], [math.nan, 1.0], [1.0, 1.0]]
    messages = [pack_image(k * MS, np.array([y]), '64FC1') for k, y in enumerate(frames)]
    feed(graph, received, publisher, messages)
    assert all(len(parse_events(bytes(message)).events) == 0 for message in received)
    code, _, err = camera.stop()
    assert code == 0, err
    assert err.count('without a logarithm') == 1


def test_a_camera_waits_for_light_where_its_references_are_stated(graph):
    camera = graph.start(CAMERA, reference_lower='[0.9]', reference_upper='[1.1]')
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('lockstep'))
    publisher = graph.node.create_publisher(Image, 'luminosity', topics.stream_qos())
    graph.turn_until(lambda: publisher.get_subscription_count() == 1)
    for k, y in enumerate((0.0, math.nan)):
        publisher.publish(pack_image(k * MS, np.full((1, 2), y), '64FC1'))
    feed(graph, received, publisher, [pack_image(2 * MS, np.ones((1, 2)), '64FC1')])
    code, _, err = camera.stop()
    assert code == 0, err
    assert 'sensor waits for light to start: reference_' in err


def test_compressed_images_are_taken(graph):
    image = pytest.importorskip('PIL.Image')
    camera = graph.start(CAMERA, event_threshold=0.1, compressed_input='true')
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('lockstep'))
    topic = 'luminosity/compressed'
    publisher = graph.node.create_publisher(CompressedImage, topic, topics.stream_qos())
    messages = []
    for k, grey in enumerate((100, 125)):
        stream = io.BytesIO()
        image.fromarray(np.full((2, 2), grey, np.uint8)).save(stream, format='png')
        message = CompressedImage(format='png', data=array.array('B', stream.getvalue()))
        message.header.stamp.nanosec = k * MS
        messages.append(message)
    feed(graph, received, publisher, messages)
    assert len(parse_events(bytes(received[-1])).events) == 8
    code, _, err = camera.stop()
    assert code == 0, err


def test_a_real_camera_is_taken_by_its_own_name_and_with_best_effort(graph):
    remapped = ('--ros-args', '-r', 'luminosity:=/camera/image_raw', '--')
    graph.start(CAMERA, *remapped, image_reliability='best_effort', mode='realtime')
    received = graph.collect(PointCloud2, 'events', topics.handshake_qos('realtime'))
    publisher = graph.node.create_publisher(Image, '/camera/image_raw', qos_profile_sensor_data)
    # Some of a best-effort publisher's images may be lost.
    images = (
        pack_image(k * MS, np.full((2, 3), 100 + 30 * (k % 2), np.uint8), 'mono8')
        for k in itertools.count()
    )

    def seen():
        return any(len(parse_events(bytes(message)).events) == 6 for message in received)

    graph.turn_until(seen, act=lambda: publisher.publish(next(images)))


def test_preset_gives_the_parameters_that_are_not_given_themselves(graph):
    graph.start(CAMERA, preset='noisy', leak_rate=0.5)
    client = graph.node.create_client(GetParameters, 'event_camera/get_parameters')
    assert client.wait_for_service(timeout_sec=20.0)
    names = ['event_threshold', 'leak_rate', 'shot_noise_rate', 'cutoff_frequency']
    reply = client.call_async(GetParameters.Request(names=names))
    graph.turn_until(reply.done)
    assert [value.double_value for value in reply.result().values] == [0.2, 0.5, 5.0, 30.0]


@pytest.mark.parametrize(
    'reliability',
    [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT],
    ids=lambda policy: policy.name,
)
def test_show_events_takes_what_a_publisher_of_any_reliability_offers(graph, reliability):
    publisher = graph.node.create_publisher(
        PointCloud2, 'events', QoSProfile(depth=10, reliability=reliability)
    )
    show = graph.start('tools.show_events', '--limit', '2')
    packet = pack_events(
        EventPacket(
            stamp_ns=MS,
            events=make_events(
                times_ns=np.array([MS - 1, MS]),
                pixels=np.array([0, 1]),
                polarities=np.array([1, -1], np.int8),
                signs=np.ones(2, np.int8),
                width=4,
                stamp_ns=MS,
                first_index=0,
            ),
        )
    )
    graph.turn_until(show.has_ended, act=lambda: publisher.publish(packet))
    code, out, err = show.wait()

    assert code == 0, err
    assert len(out.splitlines()) == 3
    best_effort = reliability == ReliabilityPolicy.BEST_EFFORT
    assert err.count('best-effort QoS: taken best effort') == best_effort
