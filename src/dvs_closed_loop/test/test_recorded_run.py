"""Bags of other writers, and recordings that began late, lost something or hold two runs."""

import numpy as np
import pytest
from recording_cases import PERIOD_NS, TYPES, packet, small_run, write_like_rosbag2

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.recorded_run import examine
from dvs_closed_loop.bags.recording import BagWriter
from dvs_common.errors import ParameterError
from dvs_common.wire import topics
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch


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
def test_estimates_find_their_commands_when_the_recording_began_late(topic, missed, tmp_path):
    recorded = small_run()
    late = [entry for entry in recorded if entry[0] == topic][missed:]
    run = recorded_run(tmp_path / 'bag', [e for e in recorded if e[0] != topic] + late)

    assert run.trace.times_s[0] == 0
    assert len(run.trace.times_s) == 60 - missed
    np.testing.assert_allclose(run.trace.estimates, run.trace.luminosities * 1.01)
    assert not run.from_start


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


def test_a_gap_in_the_running_index_is_a_loss():
    watch = IndexWatch()

    lost = [
        watch.take(parse_events(packet(k * PERIOD_NS, count, index)))
        for k, (count, index) in enumerate([(3, 2**32 - 2), (2, 1), (0, 0), (4, 8), (1, 12)])
    ]

    assert lost == [0, 0, 0, 5, 0]
    assert (watch.lost, watch.gaps, watch.events, watch.restarts) == (5, 1, 10, 0)


@pytest.mark.parametrize('damage', ['absent', 'empty', 'text', 'cut'])
def test_a_damaged_bag_is_one_clear_message(damage, tmp_path):
    path = tmp_path / 'bag.mcap'
    if damage == 'cut':
        folder = write_like_rosbag2(tmp_path / 'whole', 'mcap', small_run())
        path.write_bytes((folder / 'whole_0.mcap').read_bytes()[:-100])
    elif damage != 'absent':
        path.write_bytes(
            b'' if damage == 'empty' else b'no bag at all, but a text of some length\n'
        )

    with pytest.raises(ParameterError, match=r'^bag = '):
        read_bag(path)
