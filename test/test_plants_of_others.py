"""Plants and controllers in plain rclpy, with whatever QoS their writers thought of."""

import json
import re
import stat
import subprocess
import sys

import numpy as np
import pytest
from documentation import blocks_of
from loop_support import (
    ROOT,
    UNHURRIED,
    environment,
    listening,
    operating,
    ros_arguments,
    run_closed_loop,
    start,
    stop_all,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, JointState, PointCloud2

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import pack_image

VOLATILE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def first_sample():
    scenario = Scenario.from_values({})
    y = scenario.scene.luminosity(scenario.model, scenario.initial_state)
    return pack_image(0, np.asarray(y).reshape(1, 3), '64FC1')


@pytest.mark.parametrize('qos', [VOLATILE, BEST_EFFORT, LATCHED])
def test_a_late_subscriber_in_lockstep_gets_the_message_that_waits(qos, domain, processes):
    for executable in ('event_camera', 'hinf_controller'):
        processes.append(start(executable, domain, ros_arguments()))
    with operating(domain) as plant:
        luminosity = plant.node.create_publisher(Image, 'luminosity', 10)
        commands = plant.streams['command']
        assert plant.spin_until(lambda: luminosity.get_subscription_count() > 0)
        luminosity.publish(first_sample())
        assert plant.spin_until(lambda: bool(commands))

        late_commands = plant.collect(JointState, 'command', qos)
        late_events = plant.collect(PointCloud2, 'events', qos)
        assert plant.spin_until(lambda: bool(late_commands and late_events))
    stop_all(processes)

    assert {m.header.stamp.sec for m in late_commands} == {0}
    assert len(set(commands)) == 1


def test_no_subscriber_gets_a_message_twice(domain, processes):
    for executable in ('event_camera', 'hinf_controller'):
        processes.append(start(executable, domain, ros_arguments()))
    with operating(domain) as plant:
        luminosity = plant.node.create_publisher(Image, 'luminosity', 10)
        commands = plant.collect(JointState, 'command', VOLATILE)
        assert plant.spin_until(lambda: luminosity.get_subscription_count() > 0)
        assert plant.spin_until(lambda: bool(plant.node.get_publishers_info_by_topic('command')))
        plant.spin_until(lambda: False, timeout_s=1.0)
        luminosity.publish(first_sample())
        assert plant.spin_until(lambda: bool(commands))
        plant.spin_until(lambda: False, timeout_s=1.0)
    stop_all(processes)

    assert len(commands) == 1


def test_nodes_take_what_a_publisher_of_any_qos_offers_with_a_warning(domain, processes):
    for executable in ('event_camera', 'hinf_controller'):
        processes.append(start(executable, domain, ros_arguments()))
    with operating(domain) as plant:
        luminosity = plant.node.create_publisher(Image, 'luminosity', BEST_EFFORT)
        commands = plant.collect(JointState, 'command', VOLATILE)
        assert plant.spin_until(lambda: luminosity.get_subscription_count() > 0)
        assert plant.spin_until(lambda: bool(plant.node.get_publishers_info_by_topic('command')))

        def answered():
            luminosity.publish(first_sample())
            return plant.spin_until(lambda: bool(commands), timeout_s=0.5)

        assert plant.spin_until(answered)
    camera, controller = stop_all(processes)

    assert camera.count('luminosity has a publisher with best-effort QoS: taken best effort') == 1
    assert 'best effort' not in controller


def test_the_example_of_a_listener_counts_what_its_depth_has_cost(domain, processes):
    # A plant that is shaken: events at all times, also where a busy machine runs the loop slowly.
    shaken = {'event_threshold': 0.02, 'state_disturbance': 0.2}
    loop = ros_arguments({**UNHURRIED, **shaken})
    for executable in ('event_camera', 'hinf_controller', 'plant_sim'):
        processes.append(start(executable, domain, loop))
    with listening(domain) as first:
        assert first.spin_until(lambda: len(first.streams[topics.EVENTS]) > 100)
    listeners = [
        subprocess.Popen(
            [
                *(sys.executable, ROOT / 'examples' / 'listener.py'),
                *('--depth', str(depth), '--away', '1', '--seconds', '5'),
            ],
            env=environment(domain),
            stdout=subprocess.PIPE,
            text=True,
        )
        for depth in (2, 4000)
    ]
    shallow, deep = (listener.communicate(timeout=60)[0] for listener in listeners)
    stop_all(processes)

    numbers = [
        re.search(r'(\d+) packets, (\d+) events .* (\d+) missed', o) for o in (shallow, deep)
    ]
    (packets, events, missed), (all_packets, all_events, none) = (
        tuple(map(int, found.groups())) for found in numbers
    )
    assert none == 0 < missed
    assert all_events > events > 0
    assert all_packets > packets > 0


def test_a_plant_that_publishes_no_state_gets_a_statement_of_what_is_not_judged(domain, tmp_path):
    files = {block.file: block.body for block in blocks_of(ROOT / 'docs' / 'hardware.md')}
    motor = files['motor/lockstep_motor.py']
    dumb = [line for line in motor.splitlines(keepends=True) if 'self.state' not in line]
    plant = tmp_path / 'lockstep_motor.py'
    plant.write_text(''.join(dumb))
    plant.chmod(plant.stat().st_mode | stat.S_IXUSR)
    scenario = tmp_path / 'motor.yaml'
    scenario.write_text(files['motor/lockstep_motor.yaml'])

    run = run_closed_loop(scenario, domain, tmp_path / 'out', '--duration', '2')

    assert run.returncode == 1, run.stderr
    assert 'motor: no verdict: the plant publishes no state, so that ||x - x_d||' in run.stdout
    result = json.loads((tmp_path / 'out' / 'motor' / 'result.json').read_text())
    assert result['regulated'] is None
    # One pixel sees 1 + x: what is seen is the error itself.
    assert 0 < result['limsup_luminosity'] < 0.1
    assert 0 < result['sector_ratio_max'] <= 1
