"""Ctrl-C and SIGTERM end everything in order: exit code 0, no orphan, no traceback."""

import os
import signal
import subprocess
import time

import pytest
from loop_support import CONFIG, listening, start, stop, wait_for
from rosbags.rosbag2 import Reader

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
NUMBERS = (signal.SIGINT, signal.SIGTERM)


def appeared(listener, executable):
    names = [name for name, _ in listener.node.get_node_names_and_namespaces()]
    return executable in names


@pytest.mark.parametrize('number', NUMBERS)
@pytest.mark.parametrize('executable', NODES)
def test_a_node_ends_on_a_signal(executable, number, domain, processes):
    process = start(executable, domain)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: appeared(listener, executable))

        code, output = stop(process, number)

    assert code == 0, output
    assert 'Traceback' not in output


@pytest.mark.parametrize('executable', NODES)
def test_a_second_signal_changes_nothing(executable, domain, processes):
    process = start(executable, domain)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: appeared(listener, executable))
        process.send_signal(signal.SIGINT)
        for _ in range(5):
            time.sleep(0.03)
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        code, output = stop(process)

    assert code == 0, output
    assert 'Traceback' not in output


def children(pid):
    found = subprocess.run(
        ['ps', '-o', 'pid=', '--ppid', str(pid)], capture_output=True, text=True
    )
    return [int(line) for line in found.stdout.split()]


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize('number', NUMBERS)
def test_closed_loop_ends_on_a_signal(number, domain, processes, tmp_path):
    arguments = ['--params-file', str(CONFIG / 'mirror_r3.yaml'), '--output', str(tmp_path)]
    process = start('closed_loop', domain, [*arguments, '--duration', '1000'])
    processes.append(process)
    bag = tmp_path / 'mirror_r3' / 'bag'
    with listening(domain) as listener:
        assert listener.spin_until(lambda: len(listener.streams['command']) > 300)
    nodes = children(process.pid)
    assert len(nodes) == 3

    code, output = stop(process, number)

    assert code == 0, output
    assert 'Traceback' not in output
    assert '(interrupted)' in output
    assert not [pid for pid in nodes if is_running(pid)]
    with Reader(bag) as reader:
        counts = {c.topic.removeprefix('/'): c.msgcount for c in reader.connections}
        assert sum(1 for _ in reader.messages()) == reader.message_count
    assert counts['command'] > 100
    assert counts['events'] >= counts['command']


def test_closed_loop_names_a_node_that_dies(domain, processes, tmp_path):
    arguments = ['--params-file', str(CONFIG / 'mirror_r3.yaml'), '--output', str(tmp_path)]
    process = start('closed_loop', domain, [*arguments, '--duration', '1000'])
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: len(listener.streams['command']) > 300)
    nodes = children(process.pid)

    os.kill(nodes[1], signal.SIGKILL)
    output, _ = process.communicate(timeout=30)

    assert process.returncode == 1
    assert 'hinf_controller ended with exit code -9' in output
    assert 'Traceback' not in output
    assert not [pid for pid in nodes if is_running(pid)]


def test_closed_loop_can_be_stopped_while_it_starts(domain, processes, tmp_path):
    arguments = ['--params-file', str(CONFIG / 'mirror_r3.yaml'), '--output', str(tmp_path)]
    process = start('closed_loop', domain, arguments)
    processes.append(process)
    assert wait_for(lambda: len(children(process.pid)) == 3)
    nodes = children(process.pid)

    code, output = stop(process)

    assert code == 0, output
    assert 'Traceback' not in output
    assert not [pid for pid in nodes if is_running(pid)]


def test_closed_loop_killed_by_force_leaves_no_node(domain, processes, tmp_path):
    arguments = ['--params-file', str(CONFIG / 'mirror_r3.yaml'), '--output', str(tmp_path)]
    process = start('closed_loop', domain, [*arguments, '--duration', '1000'])
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: len(listener.streams['command']) > 3000)
    nodes = children(process.pid)
    assert len(nodes) == 3

    process.kill()
    process.wait()

    assert wait_for(lambda: not any(map(is_running, nodes)))
