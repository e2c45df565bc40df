"""Bags of other writers, and recordings that began late, lost something or hold two runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_cases import PERIOD_NS, TYPES, packet, small_run, write_like_rosbag2

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.former_estimates import FORMER_TYPE
from dvs_closed_loop.bags.loop_topics import given_topics
from dvs_closed_loop.bags.recorded_message import RecordedMessage
from dvs_closed_loop.bags.recorded_run import examine
from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.bags.stamped_runs import stamped_stream
from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_common.wire.messages import pack_array, pack_image, parse_state
from dvs_common.wire.stamped import stamp_of


def recorded_run(path, recorded):
    with BagWriter(path, TYPES) as bag:
        for topic, received, data in sorted(recorded, key=lambda entry: entry[1]):
            bag.write(topic, received, data)
    return examine(read_bag(path))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_bag_by_rosbag2_gives_the_same_run(storage, tmp_path):
    ours = recorded_run(tmp_path / 'ours', small_run())
    theirs = examine(read_bag(write_like_rosbag2(tmp_path / 'theirs', storage, small_run())))

    for name in ('times_s', 'states', 'luminosities', 'estimates', 'commands', 'event_times_s'):
        np.testing.assert_array_equal(getattr(theirs.trace, name), getattr(ours.trace, name))
    assert theirs.trace.events.tolist() == ours.trace.events.tolist()
    assert theirs.from_start
    assert theirs.streams[topics.EVENTS].messages == 60


def test_a_single_file_without_metadata_is_enough(tmp_path):
    folder = write_like_rosbag2(tmp_path / 'bag', 'mcap', small_run())

    assert examine(read_bag(folder / 'bag_0.mcap')).trace is not None


def test_one_of_two_loops_is_chosen_by_its_namespace(tmp_path):
    both = [
        (f'{side}/{topic}', received, data)
        for side in ('left', 'right')
        for topic, received, data in small_run(5 if side == 'left' else 9)
    ]
    types = {f'{side}/{t}': TYPES[t] for side in ('left', 'right') for t in TYPES if t[0] != '/'}
    with BagWriter(tmp_path / 'bag', types) as bag:
        for topic, received, data in both:
            bag.write(topic, received, data)

    with pytest.raises(ParameterError, match='/left, /right'):
        read_bag(tmp_path / 'bag')
    assert len(examine(read_bag(tmp_path / 'bag', namespace='left')).trace.times_s) == 5
    assert len(examine(read_bag(tmp_path / 'bag', namespace='/right')).trace.times_s) == 9


@pytest.mark.parametrize('missed', [1, 7])
@pytest.mark.parametrize('topic', [topics.ESTIMATE, topics.COMMAND])
def test_a_recording_that_began_late_has_what_every_stream_has(topic, missed, tmp_path):
    recorded = small_run()
    late = [entry for entry in recorded if entry[0] == topic][missed:]
    run = recorded_run(tmp_path / 'bag', [e for e in recorded if e[0] != topic] + late)

    assert run.trace.times_s[0] == 0
    assert len(run.trace.times_s) == 60 - missed
    np.testing.assert_allclose(run.trace.estimates, run.trace.luminosities * 1.01)
    assert not run.from_start


@pytest.mark.parametrize('missed', [0, 1, 7])
@pytest.mark.parametrize('topic', [topics.ESTIMATE, topics.COMMAND])
def test_estimates_of_former_bags_find_their_commands(topic, missed, tmp_path):
    recorded = [
        (t, r, pack_array(parse_state(d).values) if t == topics.ESTIMATE else d)
        for t, r, d in small_run()
    ]
    late = [entry for entry in recorded if entry[0] == topic][missed:]
    recorded = [e for e in recorded if e[0] != topic] + late
    with BagWriter(tmp_path / 'bag', {**TYPES, topics.ESTIMATE: FORMER_TYPE}) as bag:
        for name, received, data in sorted(recorded, key=lambda entry: entry[1]):
            bag.write(name, received, data)
    run = examine(read_bag(tmp_path / 'bag'))

    assert len(run.trace.times_s) == 60 - missed
    np.testing.assert_allclose(run.trace.estimates, run.trace.luminosities * 1.01)


def test_lost_messages_are_counted_where_they_are_missing(tmp_path):
    recorded = [
        entry for k, entry in enumerate(small_run()) if not (k // 5 in (20, 21) and k % 5 == 0)
    ]
    run = recorded_run(tmp_path / 'bag', recorded)

    assert run.streams[topics.STATE].missing == 2
    assert run.streams[topics.EVENTS].missing == 0
    assert len(run.trace.times_s) == 58


def test_the_last_of_two_runs_is_examined(tmp_path):
    second = [(topic, received + 10**11, data) for topic, received, data in small_run(8)]
    run = recorded_run(tmp_path / 'bag', small_run() + second)

    assert run.runs == 2
    assert len(run.trace.times_s) == 8
    assert run.index.restarts == 1
    assert run.index.lost == 0


def test_an_index_that_goes_back_within_a_run_is_named_as_a_restart(tmp_path):
    recorded = [
        (topic, received, data)
        if topic != topics.EVENTS or k < 200
        else (topic, received, packet(k // 5 * PERIOD_NS, k // 5 % 2, k // 5 // 2 - 20))
        for k, (topic, received, data) in enumerate(small_run())
    ]
    run = recorded_run(tmp_path / 'bag', recorded)

    assert (run.runs, run.index.restarts) == (1, 1)
    assert run.index.lost == 0
    assert any('camera started again (1)' in line for line in run.troubles)


def swapped(recorded, topic, first, second):
    """The run with two messages of a topic received in each other's place."""
    places = [k for k, entry in enumerate(recorded) if entry[0] == topic]
    i, j = places[first], places[second]
    recorded = list(recorded)
    recorded[i], recorded[j] = (
        (topic, recorded[i][1], recorded[j][2]),
        (topic, recorded[j][1], recorded[i][2]),
    )
    return recorded


@pytest.mark.parametrize('topic', [topics.STATE, topics.EVENTS, topics.COMMAND, topics.LUMINOSITY])
@pytest.mark.parametrize('places', [(0, 1), (30, 31), (30, 34), (58, 59)])
def test_messages_out_of_order_are_put_in_order(places, topic, tmp_path):
    whole = recorded_run(tmp_path / 'whole', small_run())
    run = recorded_run(tmp_path / 'swapped', swapped(small_run(), topic, *places))

    assert run.runs == 1
    assert run.from_start
    assert run.index.lost == run.index.restarts == 0
    assert run.trace.times_s.tolist() == whole.trace.times_s.tolist()
    assert run.trace.events.tolist() == whole.trace.events.tolist()
    assert run.streams[topic].late > 0
    assert any(f'/{topic}: ' in line and 'out of order' in line for line in run.troubles)


def test_messages_recorded_twice_count_once(tmp_path):
    twice = [entry for entry in small_run() for _ in range(2)]
    run = recorded_run(tmp_path / 'bag', twice)

    assert run.runs == 1
    assert len(run.trace.times_s) == 60
    assert run.index.events == 30
    assert run.streams[topics.EVENTS].repeated == 60


def test_unreadable_messages_are_left_out_and_counted(tmp_path):
    recorded = small_run()
    broken = {150: b'', 151: recorded[151][2][:30], 152: b'\x00\x01', 154: recorded[150][2]}
    recorded = [
        (t, received, broken.get(k, data)) for k, (t, received, data) in enumerate(recorded)
    ]
    run = recorded_run(tmp_path / 'bag', recorded)

    assert len(run.trace.times_s) == 59
    for topic in (topics.STATE, topics.LUMINOSITY, topics.EVENTS, topics.COMMAND):
        assert run.streams[topic].unreadable == 1


def test_an_image_of_another_size_is_left_out(tmp_path):
    recorded = small_run()
    recorded[151] = (*recorded[151][:2], pack_image(30 * PERIOD_NS, np.ones((2, 5)), '64FC1'))
    run = recorded_run(tmp_path / 'bag', recorded)

    assert run.trace.luminosities.shape == (59, 3)


@given(
    order=st.lists(st.integers(0, 3), min_size=40, max_size=40),
    repeats=st.lists(st.integers(1, 2), min_size=40, max_size=40),
)
def test_a_stream_is_the_same_whatever_the_order_of_neighbours(order, repeats):
    messages = [
        RecordedMessage(topic=topics.EVENTS, received_ns=k, data=packet(k * PERIOD_NS, 0, 0))
        for k in range(40)
    ]
    shuffled = sorted(range(40), key=lambda k: k + order[k])
    stream = stamped_stream(
        [messages[k] for k in shuffled for _ in range(repeats[k])], lambda data: 0
    )

    assert [run.messages for run in stream.runs] == [tuple(messages)]
    assert stream.repeated == sum(repeats) - 40


def loop_called(names, recorded, path):
    with BagWriter(path, {name: TYPES[topic] for topic, name in names.items()}) as bag:
        for topic, received, data in recorded:
            bag.write(names[topic], received, data)
    return path


NAMES = {
    topics.LUMINOSITY: '/plant/luminosity',
    topics.STATE: '/plant/state',
    topics.EVENTS: '/dvs/events',
    topics.COMMAND: '/controller/command',
    topics.ESTIMATE: '/controller/estimate',
}


def test_nodes_in_namespaces_of_their_own_are_one_loop(tmp_path):
    bag = read_bag(loop_called(NAMES, small_run(), tmp_path / 'bag'))

    assert bag.names == NAMES
    assert len(examine(bag).trace.times_s) == 60


def test_topics_of_any_name_are_found_by_type_and_content(tmp_path):
    names = {topic: f'/robot/{k}' for k, topic in enumerate(sorted(NAMES))}
    bag = read_bag(loop_called(names, small_run(), tmp_path / 'bag'))

    assert bag.names == names
    assert len(examine(bag).trace.times_s) == 60


def test_of_two_cameras_one_has_to_be_named(tmp_path):
    names = {**NAMES, 'second': '/other/events'}
    types = {name: TYPES.get(topic, TYPES[topics.EVENTS]) for topic, name in names.items()}
    with BagWriter(tmp_path / 'bag', types) as bag:
        for topic, received, data in small_run():
            bag.write(names[topic], received, data)
            if topic == topics.EVENTS:
                bag.write('/other/events', received, packet(stamp_of(data), 2, 0))

    with pytest.raises(ParameterError, match=r'from-namespace.*--topic events:=/dvs/events'):
        read_bag(tmp_path / 'bag')
    chosen = read_bag(tmp_path / 'bag', given=given_topics(['events:=/dvs/events']))
    assert examine(chosen).index.events == 30
    assert '/other/events' in chosen.ignored


@pytest.mark.parametrize(
    ('pair', 'match'),
    [
        ('events', 'must be TOPIC:=NAME'),
        ('event:=/dvs/events', 'must be among'),
        ('events:=/nowhere', 'must be one of'),
        ('events:=/plant/state', 'is a sensor_msgs/msg/JointState'),
    ],
)
def test_a_topic_that_can_not_be_is_refused(pair, match, tmp_path):
    path = loop_called(NAMES, small_run(3), tmp_path / 'bag')

    with pytest.raises(ParameterError, match=match):
        read_bag(path, given=given_topics([pair]))


@pytest.mark.parametrize('encoding', ['32FC1', 'mono8', 'mono16'])
def test_luminosity_of_every_depth_is_a_signal(encoding, tmp_path):
    kind = {'32FC1': '<f4', 'mono8': 'u1', 'mono16': '<u2'}[encoding]
    recorded = [
        (t, r, pack_image(stamp_of(d), np.full((1, 3), 7, kind), encoding))
        if t == topics.LUMINOSITY
        else (t, r, d)
        for t, r, d in small_run()
    ]
    run = recorded_run(tmp_path / 'bag', recorded)

    assert run.trace.luminosities.dtype == np.float64
    np.testing.assert_array_equal(run.trace.luminosities, np.full((60, 3), 7.0))


@pytest.mark.parametrize('damage', ['absent', 'empty', 'text'])
def test_a_damaged_bag_is_one_clear_message(damage, tmp_path):
    path = tmp_path / 'bag.mcap'
    if damage != 'absent':
        path.write_bytes(
            b'' if damage == 'empty' else b'no bag at all, but a text of some length\n'
        )

    with pytest.raises(ParameterError, match=r'^bag = '):
        read_bag(path)


@pytest.mark.parametrize('cut', [100, 5000])
def test_a_bag_without_its_end_is_read_up_to_there(cut, tmp_path):
    folder = write_like_rosbag2(tmp_path / 'whole', 'mcap', small_run())
    whole = read_bag(folder)
    path = tmp_path / 'bag.mcap'
    path.write_bytes((folder / 'whole_0.mcap').read_bytes()[:-cut])

    found = read_bag(path)

    in_order = sorted(found.messages, key=lambda message: message.received_ns)
    assert in_order == list(whole.messages[: len(in_order)])
    assert whole.damage == ''
    if cut == 100:  # In the index.
        assert len(found.messages) == len(whole.messages)
    else:
        assert 0 < len(found.messages) < len(whole.messages)
        assert 'bag.mcap: ends in the middle of a record' in found.damage
