"""Mutated messages to the real nodes of a running loop: none dies, all count what they refuse."""

import subprocess

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from loop_support import (
    CONFIG,
    UNHURRIED,
    environment,
    operating,
    program,
    ros_arguments,
    start,
    stop,
    stop_all,
)
from mutations import Mutations
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import Empty
from test_fuzz import GOOD, OTHERS
from test_health import latest

from dvs_common.wire import topics

NODES = ('event_camera', 'hinf_controller', 'plant_sim')
KINDS = {
    'luminosity': (Image, topics.stream_qos()),
    'events': (PointCloud2, topics.latched_qos()),
    'keyframe': (PointCloud2, topics.latched_qos(depth=1)),
    'anchor': (Image, topics.stream_qos()),
    'command': (JointState, topics.latched_qos()),
    'keyframe_request': (Empty, topics.stream_qos()),
}
MESSAGES = 300
# What the middleware sends at all.
SMALLEST = 4
LARGEST = {'keyframe_request': 8}


def figure(messages, node, name):
    status = latest(messages, node)
    return None if status is None else {v.key: v.value for v in status.values}.get(name)


def send_mutated(operator, publishers, count):
    """Mutated messages on every topic, from stamps that the loop has not reached."""
    mutations = Mutations(seed=5, others=OTHERS)
    for k in range(count):
        for topic, publisher in publishers.items():
            message = mutations.of(GOOD.get(topic, GOOD['command'])(100_000 + k))
            if len(message) >= SMALLEST:
                publisher.publish(message[: LARGEST.get(topic)])
        operator.spin_until(lambda: False, timeout_s=0.005)


def test_a_loop_goes_on_through_mutated_messages_on_all_its_topics(domain, processes):
    for executable in NODES:
        processes.append(start(executable, domain, ros_arguments(UNHURRIED)))
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 1000)
        estimates = operator.collect(JointState, 'estimate', 1000)
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert operator.spin_until(lambda: len(states) > 100, timeout_s=60)
        publishers = {
            topic: operator.node.create_publisher(kind, topic, qos)
            for topic, (kind, qos) in KINDS.items()
        }
        send_mutated(operator, publishers, MESSAGES)
        for publisher in publishers.values():
            operator.node.destroy_publisher(publisher)
        states.clear()
        health.clear()

        assert operator.spin_until(lambda: len(states) > 500, timeout_s=30)
        for node in NODES:
            assert operator.spin_until(lambda node=node: latest(health, node), timeout_s=10)
            assert int(figure(health, node, 'messages refused')) > MESSAGES // 10, node
        for message in (*states, *estimates):
            assert np.isfinite(message.position).all()
    for output in stop_all(processes):
        assert max(map(len, output.splitlines())) < 1000


def test_a_command_of_twenty_megabytes_is_refused_in_a_short_line(domain, processes):
    plant = start('plant_sim', domain, ros_arguments({'duration': 0.0}))
    processes.append(plant)
    huge = JointState(name=['u1'] * 1_000_000, effort=[0.0] * 1_000_000)
    with operating(domain) as operator:
        publisher = operator.node.create_publisher(JointState, 'command', topics.latched_qos())
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)

        def is_refused():
            # The first may come before the plant has met this publisher, and is not latched.
            publisher.publish(huge)
            return operator.spin_until(
                lambda: int(figure(health, 'plant_sim', 'messages refused') or 0) > 0, timeout_s=5
            )

        assert operator.spin_until(lambda: publisher.get_subscription_count() == 1)
        assert operator.spin_until(is_refused, timeout_s=60)
    code, output = stop(plant)
    assert code == 0, output
    assert 'bytes for 1 inputs' in output
    assert max(map(len, output.splitlines())) < 1000


def test_short_messages_do_not_end_closed_loop(domain, tmp_path):
    run = subprocess.Popen(
        [program('closed_loop'), '--params-file', str(CONFIG / 'mirror_r3.yaml')]
        + ['--output', str(tmp_path / 'run'), '--duration', '1'],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    with operating(domain) as operator:
        publishers = [
            operator.node.create_publisher(kind, topic, qos)
            for topic, (kind, qos) in KINDS.items()
            if topic in ('luminosity', 'events', 'command')
        ]
        while run.poll() is None:
            for publisher in publishers:
                publisher.publish(GOOD['command'](1)[:12])
            operator.spin_until(lambda: False, timeout_s=0.2)
    output = run.communicate()[0]
    assert run.returncode == 0, output
    assert 'left out of the verdict' in output
    assert 'Traceback' not in output, output
