"""Two loops side by side in two namespaces of one domain, and neither receives from the other."""

import subprocess

from loop_support import (
    CONFIG,
    environment,
    listening,
    operating,
    program,
    ros_arguments,
    run_closed_loop,
    start,
    wait_for,
)
from sensor_msgs.msg import JointState

from dvs_closed_loop.bags.bag import read_bag
from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_simulation.sampled.sampled_loop import run_sampled

STREAMS = (topics.LUMINOSITY, topics.EVENTS, topics.COMMAND, topics.STATE, topics.ESTIMATE)
LOOPS = {'left': 'mirror_r1', 'cell/right': 'mirror_r9'}
DURATION = '0.4'


def streams_of(folder, scenario):
    streams = {topic: [] for topic in STREAMS}
    for message in read_bag(folder / scenario / 'bag', topics=list(STREAMS)).messages:
        stream = streams[message.topic]
        # On a loaded machine the plant may send an unanswered sample again.
        if message.data not in stream[-1:]:
            stream.append(message.data)
    return streams


def start_loop(namespace, scenario, domain, folder):
    return subprocess.Popen(
        [
            *(program('closed_loop'), '--params-file', str(CONFIG / f'{scenario}.yaml')),
            *('--output', str(folder), '--duration', DURATION, '--namespace', namespace),
        ],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_two_loops_run_side_by_side_as_if_alone(domain, tmp_path, processes):
    with listening(domain) as listener:
        for namespace, scenario in LOOPS.items():
            processes.append(start_loop(namespace, scenario, domain, tmp_path / 'both'))
        seen = set()

        def everything_is_seen():
            seen.update(name for name, _ in listener.node.get_topic_names_and_types())
            return all(f'/{ns}/{topic}' in seen for ns in LOOPS for topic in (*STREAMS, 'clock'))

        assert wait_for(everything_is_seen)
        # The listener itself subscribes to these two, in the root.
        assert listener.node.count_publishers('/events') == 0
        assert listener.node.count_publishers('/command') == 0
        assert not seen & {'/luminosity', '/state', '/estimate', '/clock'}
    for process in processes:
        output, _ = process.communicate(timeout=60)
        assert 'results' in output, output

    for namespace, scenario in LOOPS.items():
        together = streams_of(tmp_path / 'both' / namespace, scenario)
        # test_scenarios.py shows that these are the bytes of a loop of nodes.
        alone = run_sampled(
            load_scenario(CONFIG / f'{scenario}.yaml').replace(duration=float(DURATION))
        ).messages
        assert len(alone[topics.COMMAND]) == 401
        assert together == {topic: alone[topic] for topic in STREAMS}, scenario


def test_a_remapped_loop_runs(domain, processes):
    names = {'luminosity': 'scene/y', 'events': 'dvs/ticks', 'command': 'u'}
    remaps = [word for old, new in names.items() for word in ('-r', f'{old}:={new}')]
    for executable in ('plant_sim', 'event_camera', 'hinf_controller'):
        processes.append(start(executable, domain, [*ros_arguments({'duration': 0.0}), *remaps]))
    with operating(domain) as operator:
        commands = operator.collect(JointState, names['command'], topics.handshake_qos('lockstep'))
        assert operator.spin_until(lambda: len(commands) > 200)
        publishers = operator.node.count_publishers
        assert operator.spin_until(lambda: all(publishers(new) == 1 for new in names.values()))
        assert [publishers(old) for old in names] == [0, 0, 0]


def test_a_namespace_that_is_no_name_is_refused(domain, tmp_path):
    run = run_closed_loop('mirror_r3', domain, tmp_path, '--namespace', 'not a name')

    assert run.returncode == 2
    assert run.stderr.startswith('closed_loop: namespace = not a name: must be names of letters')
    assert 'Traceback' not in run.stderr
