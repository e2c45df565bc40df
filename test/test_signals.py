"""Ctrl-C, SIGTERM and SIGHUP end everything in order: exit code 0, no orphan, no traceback."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from loop_support import CONFIG, UNHURRIED, listening, scenario_file, start, stop, wait_for
from rosbags.rosbag2 import Reader

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.recorded_run import examine

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def appeared(listener, executable):
    names = [name for name, _ in listener.node.get_node_names_and_namespaces()]
    return executable in names


@pytest.mark.parametrize(('executable', 'number'), zip(NODES, NUMBERS, strict=True))
def test_a_node_ends_on_a_signal(executable, number, domain, processes):
    process = start(executable, domain)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: appeared(listener, executable))

        code, output = stop(process, number)

    assert code == 0, output
    assert 'Traceback' not in output


def handles(pid, number):
    """Whether the process has a handler of its own for a signal (proc(5), SigCgt)."""
    status = Path(f'/proc/{pid}/status').read_text()
    return bool(int(status.split('SigCgt:')[1].split()[0], 16) >> (number - 1) & 1)


@pytest.mark.parametrize('number', NUMBERS)
@pytest.mark.parametrize(
    ('executable', 'arguments'),
    [
        ('plant_sim', []),
        ('closed_loop', ['--params-file', str(CONFIG / 'mirror_r3.yaml'), '--output', '{tmp}']),
        ('dvs_closed_loop', ['record', '{tmp}/bag']),
        ('dvs_closed_loop', ['simulate', '--params-file', str(CONFIG / 'mirror_r3.yaml')]),
    ],
    ids=['node', 'closed_loop', 'record', 'simulate'],
)
def test_a_signal_during_the_imports_ends_a_program_in_order(
    executable, arguments, number, domain, processes, tmp_path
):
    process = start(executable, domain, [a.format(tmp=tmp_path) for a in arguments])
    processes.append(process)
    # The last that is installed; Python itself handles SIGINT before.
    while not handles(process.pid, signal.SIGHUP):
        assert process.poll() is None
        time.sleep(0.002)

    code, output = stop(process, number)

    assert code == 0, output
    assert output == ''


@pytest.mark.parametrize(
    'package', ['plant_sim', 'event_camera', 'hinf_controller', 'simulation', 'closed_loop']
)
def test_an_entry_point_imports_nothing_heavy_before_it_handles_signals(package):
    program = (
        f'import dvs_{package}.programs, sys; '
        'print(*sorted({"numpy", "scipy", "rclpy", "yaml", "matplotlib"} & set(sys.modules)))'
    )
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)

    assert (run.stdout.strip(), run.stderr) == ('', '')


def test_a_closed_terminal_does_not_end_what_nohup_started(domain, processes):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        process = start('plant_sim', domain)
    finally:
        signal.signal(signal.SIGHUP, before)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: appeared(listener, 'plant_sim'))
        process.send_signal(signal.SIGHUP)
        assert not listener.spin_until(lambda: process.poll() is not None, timeout_s=0.5)
    assert stop(process)[0] == 0


def test_a_hang_up_closes_the_bag_that_is_recorded(domain, processes, tmp_path):
    bag = tmp_path / 'bag'
    process = start('dvs_closed_loop', domain, ['record', str(bag)])
    processes.append(process)
    assert wait_for(lambda: (bag / '.reserve').exists())

    code, output = stop(process, signal.SIGHUP)

    assert code == 0, output
    assert (bag / 'metadata.yaml').exists()
    assert not (bag / '.reserve').exists()


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


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP])
def test_closed_loop_ends_on_a_signal(number, domain, processes, tmp_path):
    scenario = scenario_file(tmp_path / 'mirror_r3.yaml', **UNHURRIED)
    arguments = ['--params-file', str(scenario), '--output', str(tmp_path)]
    process = start('closed_loop', domain, arguments)
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
    scenario = scenario_file(tmp_path / 'mirror_r3.yaml', **UNHURRIED)
    arguments = ['--params-file', str(scenario), '--output', str(tmp_path)]
    process = start('closed_loop', domain, arguments)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: len(listener.streams['command']) > 300)
    nodes = children(process.pid)

    os.kill(nodes[1], signal.SIGKILL)
    output, _ = process.communicate(timeout=30)

    assert process.returncode == 1
    assert 'hinf_controller was killed by signal 9' in output
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


def test_closed_loop_killed_by_force_leaves_no_node_and_a_bag_to_its_last_second(
    domain, processes, tmp_path
):
    scenario = scenario_file(tmp_path / 'mirror_r3.yaml', **UNHURRIED)
    arguments = ['--params-file', str(scenario), '--output', str(tmp_path)]
    process = start('closed_loop', domain, arguments)
    processes.append(process)
    with listening(domain) as listener:
        assert listener.spin_until(lambda: len(listener.streams['command']) > 500)
        a_second_ago = len(listener.streams['command'])
        listener.spin_until(lambda: False, timeout_s=1.0)
    nodes = children(process.pid)
    assert len(nodes) == 3

    process.kill()
    process.wait()

    assert wait_for(lambda: not any(map(is_running, nodes)))
    bag = tmp_path / 'mirror_r3' / 'bag'
    assert examine(read_bag(bag)).streams['command'].messages >= a_second_ago
    report = start('dvs_closed_loop', domain, ['report', str(bag)])
    processes.append(report)
    output, _ = report.communicate(timeout=60)
    assert report.returncode == 0, output
    assert 'mirror_r3' in output
