"""Bags as people have them, read as one recording: ROS 2 and ROS 1, whole and in pieces."""

from itertools import pairwise

import numpy as np
import pytest
from sensor_encoders import (
    SAMPLES,
    caer_cmp_words,
    evt3_words,
    packet_message,
    same,
    some_events,
)

from dvs_common.errors import ParameterError
from dvs_common.wire.events import pack_events
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.files.bag_recording import bag_recording
from dvs_event_camera.files.damage import DamagedFile
from dvs_event_camera.files.event_array import (
    EVENT_ARRAY,
    event_array_from_ros1,
    parse_event_array,
)
from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.streams.event_packet import MESSAGE_TYPE
from dvs_event_camera.streams.sensor_events import SensorEvents, joined
from dvs_event_camera.streams.wire_stream import WireStream

rosbag2 = pytest.importorskip('rosbags.rosbag2')
typesys = pytest.importorskip('rosbags.typesys')
stores = pytest.importorskip('rosbags.typesys.stores.ros2_jazzy')

CLOUD = 'sensor_msgs/msg/PointCloud2'
PACKET = (
    'std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n'
    'string encoding\nbool is_bigendian\nuint8[] events\n'
)
EVENT = 'uint16 x\nuint16 y\n{time} ts\nbool polarity\n'
ARRAY = 'std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n'
START = 1_700_000_000_000_000_000


def types(ros1=False):
    store = typesys.get_typestore(
        typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_JAZZY
    )
    time = 'time' if ros1 else 'builtin_interfaces/Time'
    for text, name in (
        (EVENT.format(time=time), 'dvs_msgs/msg/Event'),
        (ARRAY, EVENT_ARRAY),
        (PACKET, MESSAGE_TYPE),
    ):
        store.register(typesys.get_types_from_msg(text, name))
    return store


def pieces(events, count):
    cuts = np.linspace(0, len(events), count + 1).astype(int)
    return [events.take(slice(a, b)) for a, b in pairwise(cuts)]


def packets(events, count=6):
    """EventPacket messages of libcaer_driver."""
    return [
        packet_message(
            caer_cmp_words(part, int(part.t[0])),
            'libcaer_cmp',
            stamp_ns=START + k,
            sequence=k,
            time_base=int(part.t[0]),
        )
        for k, part in enumerate(pieces(events, count))
    ]


def clouds(events, count=6):
    """Messages of our own camera."""
    stream = WireStream()
    return [
        pack_events(packet)
        for part in pieces(events, count)
        for packet in stream.packets(part, int(part.t[-1]))
    ]


def write_bag(path, topics, *, mode=None, storage='MCAP'):
    """A bag of {topic: (type, messages)} in the order of the messages."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if mode:
        writer.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
    with writer:
        for name, (kind, messages) in topics.items():
            connection = writer.add_connection(name, kind, typestore=types())
            for k, message in enumerate(messages):
                writer.write(connection, START + k, message)
    return path


def read(path, topic=None):
    return joined([stretch.events for stretch in open_recording(path, topic).read()])


@pytest.fixture
def events():
    return some_events(2000, start_us=START // 1000 % 10**12)


@pytest.mark.parametrize('storage', ['MCAP', 'SQLITE3'])
@pytest.mark.parametrize('mode', [None, 'FILE', 'MESSAGE'])
@pytest.mark.parametrize('form', ['folder', 'no metadata', 'no storage named', 'single file'])
def test_a_bag_of_ros_2_in_every_form(storage, mode, form, events, tmp_path):
    folder = write_bag(
        tmp_path / 'bag',
        {'/cam/events': (MESSAGE_TYPE, packets(events))},
        mode=mode,
        storage=storage,
    )
    path = folder
    metadata = folder / 'metadata.yaml'
    if form == 'no metadata':
        metadata.unlink()
    elif form == 'no storage named':
        text = metadata.read_text()
        metadata.write_text(
            text.replace('storage_identifier: ' + storage.lower(), 'storage_identifier: ""')
        )
        assert metadata.read_text() != text
    elif form == 'single file':
        path = next(file for file in folder.iterdir() if file != metadata)

    recording = open_recording(path)

    assert (recording.encoding, recording.width, recording.height) == ('libcaer_cmp', 346, 260)
    assert same(joined([s.events for s in recording.read()]), events)


def test_our_own_events_come_back_with_their_labels(events, tmp_path):
    noise = (np.arange(len(events)) % 2).astype(np.uint8)
    labelled = SensorEvents(t=events.t, x=events.x, y=events.y, p=events.p, noise=noise)
    path = write_bag(
        tmp_path / 'bag',
        {
            '/robot/events': (CLOUD, clouds(events)),
            '/robot/events_label': (CLOUD, clouds(labelled)),
            '/robot/points': (CLOUD, []),
        },
    )

    found = read(path)
    plain = read(path, 'events')

    assert found.noise is not None
    assert np.array_equal(np.sort(found.packed()), np.sort(events.packed()))
    assert int(found.noise.sum()) == int(noise.sum())
    assert plain.noise is None
    assert np.array_equal(np.sort(plain.packed()), np.sort(events.packed()))


def event_array(store, events, ros1):
    kinds = ('dvs_msgs/msg/Event', EVENT_ARRAY, 'std_msgs/msg/Header')
    event, array, header = (store.types[kind] for kind in kinds)
    time = stores.builtin_interfaces__msg__Time
    rows = zip(events.t.tolist(), events.x, events.y, events.p, strict=True)
    listed = [
        event(x=int(x), y=int(y), ts=time(sec=t // 10**9, nanosec=t % 10**9), polarity=bool(p))
        for t, x, y, p in rows
    ]
    fields = {'stamp': time(sec=5, nanosec=7), 'frame_id': 'dvs'}
    if ros1:
        fields['seq'] = 3
    return array(header=header(**fields), height=260, width=346, events=listed)


@pytest.mark.parametrize('count', [0, 1, 2, 5])
def test_event_arrays_are_the_bytes_that_rosbags_writes(count):
    events = some_events(count)
    modern, former = types(), types(ros1=True)
    cdr = bytes(modern.serialize_cdr(event_array(modern, events, False), EVENT_ARRAY))
    ros1 = bytes(former.serialize_ros1(event_array(former, events, True), EVENT_ARRAY))

    found = parse_event_array(cdr)

    assert same(found.events, events)
    assert (found.stamp_ns, found.width, found.height) == (5_000_000_007, 346, 260)
    assert event_array_from_ros1(ros1).rstrip(b'\0') == cdr.rstrip(b'\0')
    with pytest.raises(ValueError, match=r'fit|early'):
        parse_event_array(cdr[: -17 if count else -4])
    with pytest.raises(ValueError, match='cut short'):
        event_array_from_ros1(ros1[:-1])


@pytest.mark.parametrize('kind', [EVENT_ARRAY, MESSAGE_TYPE])
def test_a_bag_of_ros_1(kind, events, tmp_path):
    rosbag1 = pytest.importorskip('rosbags.rosbag1')
    path = tmp_path / 'dvs.bag'
    store = types(ros1=True)
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection('/dvs/events', kind, typestore=store)
        if kind == EVENT_ARRAY:
            messages = [
                store.serialize_ros1(event_array(store, part, True), kind)
                for part in pieces(events, 4)
            ]
        else:
            messages = [types().cdr_to_ros1(packet, kind) for packet in packets(events)]
        for k, message in enumerate(messages):
            writer.write(connection, START + k, message)

    assert same(read(path), events)
    assert open_recording(path).width == 346


def check_cut_off(path, events, shares, reason):
    """Cut off a bag at two shares of its bytes: all whole messages are there, and no others."""
    octets = path.read_bytes()
    seen = []
    for share in shares:
        path.write_bytes(octets[: round(share * len(octets))])
        parts = []
        with pytest.raises(DamagedFile, match=reason):
            for stretch in open_recording(path).read():
                parts.append(stretch.events)
        found = joined(parts)
        assert np.array_equal(found.packed(), events.packed()[: len(found)])
        seen.append(len(found))
    assert 0 < seen[0] < seen[1] < len(events)


@pytest.mark.parametrize(
    ('storage', 'shares', 'reason'),
    [
        ('MCAP', (0.5, 0.75), 'ends in the middle of a record'),
        # The root of its tree of messages is in the first half of so small a database.
        ('SQLITE3', (0.75, 0.875), 'is cut off or damaged'),
    ],
)
def test_a_bag_that_was_cut_off_gives_all_whole_messages(
    storage, shares, reason, events, tmp_path
):
    messages = {'/events': (MESSAGE_TYPE, packets(events, 40))}
    folder = write_bag(tmp_path / 'bag', messages, storage=storage)
    check_cut_off(next(folder.glob('bag.*')), events, shares, reason)


@pytest.mark.parametrize('compression', [None, 'BZ2', 'LZ4'])
def test_a_bag_of_ros1_that_was_cut_off_gives_all_whole_messages(compression, events, tmp_path):
    rosbag1 = pytest.importorskip('rosbags.rosbag1')
    path = tmp_path / 'cut.bag'
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = 2000
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        connection = writer.add_connection('/events', MESSAGE_TYPE, typestore=types())
        for k, message in enumerate(packets(events, 40)):
            writer.write(connection, START + k, types().cdr_to_ros1(message, MESSAGE_TYPE))
    check_cut_off(path, events, (0.5, 0.75), 'ends in the middle of a record')


def test_messages_that_are_broken_are_left_out_and_counted(events, tmp_path):
    messages = packets(events)
    whole = len(joined([part for k, part in enumerate(pieces(events, 6)) if k != 2]))
    messages[2] = packet_message(b'1', 'libcaer_cmp')
    path = write_bag(tmp_path / 'bag', {'/events': (MESSAGE_TYPE, messages)})
    parts = []
    with pytest.raises(DamagedFile, match='1 messages of /events are left out') as raised:
        for stretch in bag_recording(path).read():
            parts.append(stretch.events)

    assert len(joined(parts)) == whole
    assert 'multiple of 2' in str(raised.value)


def test_a_bag_of_two_cameras_asks_which(events, tmp_path):
    path = write_bag(
        tmp_path / 'bag',
        {
            '/left/events': (MESSAGE_TYPE, packets(events)),
            '/right/events': (MESSAGE_TYPE, packets(events)[:2]),
        },
    )

    with pytest.raises(ParameterError, match='must be one of /left/events, /right/events'):
        open_recording(path)
    assert same(read(path, 'left/events'), events)
    assert len(read(path, '/right/events')) < len(events)


def test_a_bag_that_lacks_one_of_its_files_is_read_as_far_as_it_is_there(events, tmp_path):
    path = write_bag(tmp_path / 'bag', {'/events': (MESSAGE_TYPE, packets(events))})
    metadata = path / 'metadata.yaml'
    text = metadata.read_text()
    name = next(path.glob('*.mcap')).name
    metadata.write_text(text.replace(f'- {name}', f'- {name}\n  - gone_1.mcap', 1))
    if 'gone_1' not in metadata.read_text():
        metadata.write_text(text.replace(f'[{name}]', f'[{name}, gone_1.mcap]'))
    parts = []
    with pytest.raises(DamagedFile, match=r'lacks gone_1\.mcap'):
        for stretch in open_recording(path).read():
            parts.append(stretch.events)

    assert same(joined(parts), events)


def test_split_bags_without_metadata_are_read_in_natural_order(events, tmp_path):
    folder = tmp_path / 'bag'
    folder.mkdir()
    for number, part in zip((2, 10), pieces(events, 2), strict=True):
        one = write_bag(tmp_path / f'part{number}', {'/events': (MESSAGE_TYPE, packets(part))})
        next(one.glob('*.mcap')).rename(folder / f'bag_{number}.mcap')

    assert same(read(folder), events)


def test_words_of_evt3_go_on_from_message_to_message(events, tmp_path):
    small = some_events(2000)
    words = np.array_split(evt3_words(small), 9)
    messages = [packet_message(part, 'evt3', sequence=k) for k, part in enumerate(words)]
    path = write_bag(tmp_path / 'bag', {'/events': (MESSAGE_TYPE, messages)})

    assert same(read(path), small)


def test_a_folder_that_is_no_bag_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r'is not a rosbag2: .*\.db3$'):
        BagFile(tmp_path)

    (tmp_path / 'bag').mkdir()
    with pytest.raises(ParameterError, match=f'there is a folder {tmp_path}/bag'):
        BagFile(tmp_path)


@pytest.mark.skipif(not SAMPLES.exists(), reason='no recordings here')
def test_a_recording_whose_metadata_name_no_storage_is_whole():
    with BagFile(SAMPLES / 'ecp_test_events_2') as bag:
        assert [topic.name for topic in bag.topics] == ['/event_camera/events']
        assert sum(1 for _ in bag.messages()) == 100
