"""Recording and replay with real processes; replayed events give the recorded commands."""

import os
import re
import subprocess
import time
from itertools import pairwise

import numpy as np
import pytest
from loop_support import (
    UNHURRIED,
    environment,
    listening,
    operating,
    program,
    run_closed_loop,
    scenario_file,
    start,
    stop,
    wait_for,
)
from mcap.reader import make_reader
from rclpy.qos import qos_profile_sensor_data
from sensor_encoders import large_dat_file
from sensor_msgs.msg import Image, PointCloud2

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.bag_recorder import BagRecorder
from dvs_closed_loop.bags.recorded_run import examine
from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.bags.streams import STREAMS
from dvs_common.wire import topics
from dvs_common.wire.events import LABELLED_EVENT_DTYPE, EventPacket, pack_events, parse_events
from dvs_common.wire.messages import pack_clock, parse_command
from dvs_common.wire.stamped import stamp_of
from dvs_hinf_controller.analysis.sector import sector
from dvs_simulation.judging.verdict import sector_ratios


def lines_until(process, wanted):
    """Lines that the process prints until all of `wanted` have come."""
    seen = []
    while not set(wanted) <= set(seen):
        line = process.stdout.readline()
        assert line, f'ended after {seen}'
        seen.append(line.strip())
    return seen


def whole_recording(scenario, new_domain, folder):
    """A short run from the first packet that its controller took, or None."""
    bag = folder / scenario.stem / 'bag'
    result = run_closed_loop(scenario, new_domain(), folder, '--duration', '1')
    assert bag.is_dir(), result.stderr
    recorded = read_bag(bag)
    first = [stamp_of(recorded.of(topic)[0]) for topic in (topics.EVENTS, topics.COMMAND)]
    return recorded if first[0] == first[1] and not examine(recorded).index.first_index else None


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_replayed_events_give_the_recorded_commands(mode, new_domain, processes, tmp_path):
    # A slow machine must not end the run: only its bytes matter here.
    period = 0.001 if mode == 'lockstep' else 0.01
    changes = {
        'sampling_period': period,
        'nonphysical_luminosity': 'clamp',
        'command_timeout': 9.0,
    }
    scenario = scenario_file(tmp_path / 'run.yaml', mode=mode, **changes)
    # In realtime the nodes may meet too late for a recording of the very first packets.
    attempts = (whole_recording(scenario, new_domain, tmp_path / str(k)) for k in range(4))
    original = next((bag for bag in attempts if bag is not None), None)
    assert original is not None

    domain = new_domain()
    controller = start('hinf_controller', domain, ['--ros-args', '--params-file', str(scenario)])
    processes.append(controller)
    again = tmp_path / 'again'
    recorder = start('dvs_closed_loop', domain, ['record', str(again), '--topics', 'command'])
    processes.append(recorder)
    lines_until(recorder, ['receives command'])
    # The controller may take some seconds longer to meet the recorder than the other way round.
    rate = '20' if mode == 'lockstep' else '0.5'
    options = ['--topics', 'events', '--wait', '--delay', '4', '--rate', rate]
    player = start('dvs_closed_loop', domain, ['play', str(original.path), *options])
    processes.append(player)
    output, _ = player.communicate(timeout=90)
    assert player.returncode == 0, output
    count = len(original.of(topics.EVENTS))
    assert f'{count} of {count} messages played' in output
    code, output = stop(recorder)

    assert code == 0, output
    commands = original.of(topics.COMMAND)
    assert len(commands) > 30
    assert read_bag(again).of(topics.COMMAND)[: len(commands)] == commands


def test_a_running_loop_is_recorded_until_ctrl_c_and_reported(domain, processes, tmp_path):
    scenario = scenario_file(tmp_path / 'slow.yaml', **UNHURRIED)
    bag = tmp_path / 'bag'
    recorder = start('dvs_closed_loop', domain, ['record', str(bag), '--storage', 'sqlite3'])
    processes.append(recorder)
    lines_until(recorder, [f'recording 10 topics to {bag}/'])
    for node in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(start(node, domain, ['--ros-args', '--params-file', str(scenario)]))
    received = ['luminosity', 'events', 'command', 'state', 'estimate']
    lines_until(recorder, [f'receives {topic}' for topic in received])
    with pytest.raises(subprocess.TimeoutExpired):
        recorder.wait(timeout=3)
    code, output = stop(recorder)
    for node in processes[1:]:
        stop(node)

    assert code == 0, output
    assert 'Traceback' not in output
    assert 'no event lost' in output
    recorded = read_bag(bag)
    # The nodes gave their parameters.
    assert recorded.scenario['real_time_factor'] == UNHURRIED['real_time_factor']
    # A sample that waited half a second is answered again, under the same stamp.
    stamps = sorted({parse_command(message).stamp_ns for message in recorded.of(topics.COMMAND)})
    assert len(stamps) > 300
    assert {later - earlier for earlier, later in pairwise(stamps)} == {10**6}
    run = examine(recorded)
    assert len(run.trace.times_s) > 300
    sensor = recorded.scenario.sensor
    known = sector(
        recorded.scenario.model_reference_bounds,
        event_threshold=sensor.event_threshold,
        log_base=sensor.log_base,
    )
    assert sector_ratios(run.trace, recorded.scenario, known.error_bound).max() <= 1 + 1e-9


def test_duration_ends_a_recording_and_the_bag_is_not_overwritten(domain, tmp_path):
    command = [program('dvs_closed_loop'), 'record', str(tmp_path / 'bag'), '--duration', '0.3']
    command += ['--topics', topics.COMMAND]
    first = subprocess.run(command, env=environment(domain), capture_output=True, text=True)
    second = subprocess.run(command, env=environment(domain), capture_output=True, text=True)

    assert first.returncode == 0, first.stderr
    assert first.stdout.endswith('nothing received\n')
    assert second.returncode == 2
    assert 'is not overwritten' in second.stderr
    assert 'Traceback' not in second.stderr


def test_a_full_disk_ends_a_recording_with_an_error(domain, processes, tmp_path):
    scenario = scenario_file(tmp_path / 'fast.yaml', duration=0.0)
    bag = tmp_path / 'bag'
    limited = 'ulimit -f 400; exec "$@"'  # in blocks of 1024 bytes
    recorder = subprocess.Popen(
        ['bash', '-c', limited, 'bash', program('dvs_closed_loop'), 'record', str(bag)],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    processes.append(recorder)
    for node in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(start(node, domain, ['--ros-args', '--params-file', str(scenario)]))

    output, errors = recorder.communicate(timeout=90)
    for node in processes[1:]:
        stop(node)

    assert recorder.returncode == 1, output + errors
    assert 'File too large' in errors
    assert 'Traceback' not in errors
    assert len(read_bag(bag).messages) > 300


def test_a_publisher_that_appears_without_latching_is_recorded(domain, tmp_path):
    stream = STREAMS[topics.COMMAND]
    # The recorder adapts while what DDS says of the driver still waits to be handled.
    with (
        listening(domain) as tool,
        listening(domain) as driver,
        BagWriter(tmp_path / 'bag', {'/command': stream.type_name}) as bag,
    ):
        recorder = BagRecorder(tool.node, [stream], bag)
        tool.spin_until(lambda: False, timeout_s=0.2)
        publisher = driver.node.create_publisher(
            stream.message_type, stream.topic, topics.handshake_qos('realtime')
        )
        assert wait_for(lambda: tool.node.count_publishers(stream.topic) == 1)
        recorder.adapt()
        assert tool.spin_until(lambda: recorder.newly_received() == [stream.topic])
        assert driver.spin_until(lambda: publisher.get_subscription_count() == 1)
        before_ns = time.time_ns()
        publisher.publish(stream.message_type())
        after_ns = time.time_ns()
        time.sleep(0.05)
        assert tool.spin_until(lambda: recorder.counts[stream.topic] == 1)

    # Received long after it was published: the bag has both times.
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        ((_, _, message),) = make_reader(file).iter_messages()
    assert before_ns <= message.publish_time <= after_ns
    assert message.log_time - message.publish_time >= 40_000_000


def test_streams_on_demand_are_recorded_by_name(domain, processes, tmp_path):
    named = [topics.EVENTS_LABEL, topics.EVENTS_PACKET, topics.POLARITY, topics.EVENT_IMAGE]
    bag = tmp_path / 'bag'
    with listening(domain) as driver:
        recorder = start('dvs_closed_loop', domain, ['record', str(bag), '--topics', *named])
        processes.append(recorder)
        publishers = {
            name: driver.node.create_publisher(
                STREAMS[name].message_type, name, STREAMS[name].offered_qos
            )
            for name in named
        }
        assert driver.spin_until(
            lambda: all(p.get_subscription_count() for p in publishers.values())
        )
        # The recorder may be matched a moment later than we know of it.
        label = np.zeros(1, LABELLED_EVENT_DTYPE)
        for k in range(20):
            # Of two events one is lost.
            label['index'] = 2 * k
            publishers[topics.EVENTS_LABEL].publish(
                pack_events(EventPacket(stamp_ns=k, events=label))
            )
            for name in named[1:]:
                publishers[name].publish(b'\x00\x01\x00\x00' + bytes(64))
            driver.spin_until(lambda: False, timeout_s=0.1)
        lines_until(recorder, [f'receives {name}' for name in named])
        code, output = stop(recorder)

    assert code == 0, output
    events, lost, gaps = map(
        int, re.search(r'(\d+) events, (\d+) EVENTS LOST in (\d+) gaps', output).groups()
    )
    assert events > 1 and lost == gaps == events - 1
    with (bag / 'bag.mcap').open('rb') as file:
        found = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert found == {f'/{name}' for name in named}


@pytest.mark.parametrize('waits', [[], ['--wait']])
def test_play_waits_for_subscribers_and_ends_on_ctrl_c(waits, domain, processes, tmp_path):
    with BagWriter(tmp_path / 'bag', {topics.CLOCK: 'rosgraph_msgs/msg/Clock'}) as bag:
        bag.write(topics.CLOCK, 0, pack_clock(0))
    player = start('dvs_closed_loop', domain, ['play', str(tmp_path / 'bag'), *waits])
    processes.append(player)
    lines_until(player, ['waiting for subscribers of /clock'])

    code, output = stop(player)

    assert code == 0, output
    assert 'Traceback' not in output
    assert '0 of 1 messages played' in output


def test_play_begins_at_once_with_no_wait(domain, processes, tmp_path):
    with BagWriter(tmp_path / 'bag', {topics.CLOCK: 'rosgraph_msgs/msg/Clock'}) as bag:
        bag.write(topics.CLOCK, 0, pack_clock(0))
    player = start('dvs_closed_loop', domain, ['play', str(tmp_path / 'bag'), '--no-wait'])
    processes.append(player)

    output, _ = player.communicate(timeout=60)

    assert player.returncode == 0, output
    assert '1 of 1 messages played' in output


def test_a_file_of_a_sensor_is_played_as_our_events(domain, processes, tmp_path):
    t = 10**6 * np.arange(1, 61)
    x, y, p, noise = t // 10**6 % 40, t // 10**6 % 30, t // 10**6 % 2, t // 10**6 % 3 == 0
    np.savez(tmp_path / 'sensor.npz', x=x, y=y, t=t, p=p, noise=noise)
    with listening(domain) as listener:
        received, labels = listener.streams[topics.EVENTS], []
        kind, qos = STREAMS[topics.EVENTS].message_type, topics.stream_qos()
        listener.node.create_subscription(kind, topics.EVENTS_LABEL, labels.append, qos, raw=True)
        arguments = ['play', str(tmp_path / 'sensor.npz'), '--wait', '--binning', '2']
        region = ['--region', '10', '0', '20', '30']
        player = start('dvs_closed_loop', domain, [*arguments, *region])
        processes.append(player)
        assert listener.spin_until(lambda: player.poll() is not None)
        listener.spin_until(lambda: len(labels) >= len(received), 5)
    inside = (x >= 10) & (x < 30)
    packets = [parse_events(bytes(message)) for message in received]
    assert player.returncode == 0, player.stdout.read()
    events = np.concatenate([packet.events for packet in packets])
    times = np.concatenate([packet.stamp_ns + packet.events['t'] for packet in packets])
    assert np.array_equal(times, t[inside])
    assert np.array_equal(events['x'], (x[inside] - 10) // 2)
    assert np.array_equal(events['y'], y[inside] // 2)
    assert np.array_equal(events['polarity'], 2 * p[inside] - 1)
    assert events['index'].tolist() == list(range(len(events)))
    noisy = np.concatenate([parse_events(bytes(message)).events for message in labels])
    assert int(noisy['noise'].sum()) == int(noise[inside].sum())


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['play', 'BAG', '--rate', '0'], 'rate = 0.0'),
        (['play', 'nowhere'], 'bag = nowhere'),
        (['record', 'new', '--topics', 'evnts'], 'topics = evnts: must be among'),
        (['record', 'new', '--duration', '-1'], 'duration = -1.0: must be > 0'),
        (['record', 'new', '--namespace', '1 bad'], 'namespace = 1 bad'),
        (['dashboard', '--port', '99999'], 'port = 99999'),
    ],
)
def test_wrong_arguments_are_one_clear_message(arguments, message, domain, tmp_path):
    result = subprocess.run(
        [program('dvs_closed_loop'), *arguments],
        env=environment(domain),
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )

    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def test_a_best_effort_camera_is_recorded_and_named_as_one(domain, processes, tmp_path):
    recorder = start(
        'dvs_closed_loop', domain, ['record', str(tmp_path / 'bag'), '--topics', 'luminosity']
    )
    processes.append(recorder)
    image = Image(height=1, width=2, encoding='mono8', step=2, data=[1, 2])
    with operating(domain) as camera:
        publisher = camera.node.create_publisher(Image, 'luminosity', qos_profile_sensor_data)
        camera.node.create_timer(0.05, lambda: publisher.publish(image))
        assert camera.spin_until(lambda: publisher.get_subscription_count() > 0)
        camera.spin_until(lambda: False, timeout_s=0.5)
    code, output = stop(recorder)

    assert code == 0, output
    assert 'luminosity has a publisher with best-effort QoS' in output
    assert len(read_bag(tmp_path / 'bag').messages) >= 3


@pytest.mark.long
def test_a_hundred_million_events_are_played_in_half_a_gigabyte(domain, processes, tmp_path):
    path = large_dat_file(tmp_path / 'large.dat', 100)
    received = 0

    def count(message):
        nonlocal received
        received += len(parse_events(message).events)

    with operating(domain) as listener:
        qos = STREAMS[topics.EVENTS].offered_qos
        listener.node.create_subscription(PointCloud2, topics.EVENTS, count, qos, raw=True)
        player = start('dvs_closed_loop', domain, ['play', str(path), '--wait', '--rate', '0.1'])
        processes.append(player)
        ended = []

        def has_ended():
            ended[:] = os.wait4(player.pid, os.WNOHANG)
            return ended[0] == player.pid

        assert listener.spin_until(has_ended, timeout_s=600)
        listener.spin_until(lambda: received == 10**8, timeout_s=5)
    _, status, used = ended

    assert status == 0
    assert '100000000 events played' in player.stdout.read()
    assert received == 10**8
    assert used.ru_maxrss / 1024 < 500
