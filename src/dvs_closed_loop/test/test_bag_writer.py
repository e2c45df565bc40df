"""Bags that rosbags itself reads back byte by byte, whatever happened while they were written."""

import shutil

import pytest
from recorded_messages import MS, recorded
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dvs_closed_loop.bags import recording
from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.bag_metadata import BagTopic
from dvs_closed_loop.bags.former_estimates import FORMER_TYPE
from dvs_closed_loop.bags.recording import STORAGES, BagWriter
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.streams.event_packet import DEFINITION, MESSAGE_TYPE

TYPES = {
    'state': 'sensor_msgs/msg/JointState',
    'events': 'sensor_msgs/msg/PointCloud2',
    '/clock': 'rosgraph_msgs/msg/Clock',
}
MESSAGES = recorded([([k], [1, 2, 3], [1, 2, 3]) for k in range(5)], events_per_sample=2)


def write(bag):
    for k, (state, events) in enumerate(zip(MESSAGES['state'], MESSAGES['events'], strict=True)):
        bag.write('state', k * MS, state)
        bag.write('events', k * MS + 1, events)


def contents(path):
    with Reader(path) as reader:
        return [(c.topic, time_ns, bytes(data)) for c, time_ns, data in reader.messages()]


EXPECTED = [
    entry
    for k, (state, events) in enumerate(zip(MESSAGES['state'], MESSAGES['events'], strict=True))
    for entry in (('/state', k * MS, state), ('/events', k * MS + 1, events))
]


@pytest.mark.parametrize('storage', STORAGES)
def test_messages_read_back_byte_by_byte_under_absolute_names(storage, tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag:
        write(bag)

    assert contents(tmp_path / 'bag') == EXPECTED
    with Reader(tmp_path / 'bag') as reader:
        types = {c.topic: c.msgtype for c in reader.connections}
        assert types == {f'/{topic.lstrip("/")}': kind for topic, kind in TYPES.items()}
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {'/state': 5, '/events': 5, '/clock': 0}
        assert (reader.start_time, reader.message_count) == (0, 10)


@pytest.mark.parametrize('storage', STORAGES)
def test_an_exception_leaves_a_readable_bag(storage, tmp_path):
    with (
        pytest.raises(RuntimeError, match='boom'),
        BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag,
    ):
        write(bag)
        raise RuntimeError('boom')

    assert contents(tmp_path / 'bag') == EXPECTED


@pytest.mark.parametrize('storage', STORAGES)
def test_a_bag_without_messages_is_readable(storage, tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage):
        pass

    assert contents(tmp_path / 'bag') == []


def test_the_messages_decode_as_the_types_that_the_bag_names(tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES) as bag:
        write(bag)

    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(tmp_path / 'bag') as reader:
        decoded = [store.deserialize_cdr(data, c.msgtype) for c, _, data in reader.messages()]
    assert [message.position.tolist() for message in decoded[::2]] == [[k] for k in range(5)]
    assert [message.width for message in decoded[1::2]] == [0, 2, 2, 2, 2]


def test_the_types_of_the_wire_contract_are_described_as_rosbags_does():
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(DEFINITION, MESSAGE_TYPE))

    for name in {FORMER_TYPE, *(stream.type_name for stream in STREAMS.values())}:
        topic = BagTopic.of('/topic', name, None)
        assert topic.definition == store.generate_msgdef(name, ros_version=2)[0]
        assert topic.type_hash == store.hash_rihs01(name)


def test_a_bag_is_not_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'precious').write_text('data')

    with pytest.raises(ParameterError, match='exists already and is not overwritten'):
        BagWriter(tmp_path / 'bag', TYPES)
    assert (tmp_path / 'bag' / 'precious').read_text() == 'data'


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / 'file').write_text('')

    with pytest.raises(ParameterError, match="can't be written"):
        BagWriter(tmp_path / 'file' / 'bag', TYPES)


def test_the_scenario_travels_with_the_bag(tmp_path):
    scenario = Scenario.from_values({'event_threshold': 0.123, 'command_limit': [3.0]})
    with BagWriter(tmp_path / 'bag', TYPES) as bag:
        bag.keep_scenario(scenario, 'name of it')
        write(bag)

    found = read_bag(tmp_path / 'bag')

    assert found.scenario_name == 'name of it'
    assert found.scenario is not None
    assert found.scenario.values == scenario.values
    assert found.of('state') == MESSAGES['state']


@pytest.mark.parametrize('storage', STORAGES)
def test_the_scenario_is_in_a_bag_whose_recorder_never_came_to_its_end(
    storage, tmp_path, monkeypatch
):
    monkeypatch.setattr(recording, '_FLUSH_PERIOD_S', 0)
    scenario = Scenario.from_values({'event_threshold': 0.123})
    cut_off = tmp_path / 'cut_off'
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag:
        write(bag)
        bag.keep_scenario(scenario, 'name of it')
        shutil.copytree(tmp_path / 'bag', cut_off)

    assert not (cut_off / 'metadata.yaml').exists()
    file = next(cut_off.glob('bag.*'))
    for path in (cut_off, file, tmp_path / 'bag' / file.name):
        found = read_bag(path)
        assert found.scenario is not None, path
        assert (found.scenario.values, found.scenario_name) == (scenario.values, 'name of it')
        assert found.writer == 'jazzy'
    assert contents(tmp_path / 'bag') == EXPECTED


@pytest.mark.parametrize('storage', STORAGES)
def test_the_last_scenario_kept_counts(storage, tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES, storage=storage) as bag:
        for threshold in (0.1, 0.2, 0.2):
            bag.keep_scenario(Scenario.from_values({'event_threshold': threshold}), 'it')
            write(bag)

    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert read_bag(tmp_path / 'bag').scenario['event_threshold'] == 0.2


def test_a_bag_with_a_broken_scenario_is_refused_in_one_line(tmp_path):
    with BagWriter(tmp_path / 'bag', TYPES) as bag:
        bag.keep_scenario(Scenario.from_values({}), 'it')
        write(bag)
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('{"', '{', 1))

    with pytest.raises(ParameterError, match='holds a broken scenario'):
        read_bag(tmp_path / 'bag')
