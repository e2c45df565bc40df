"""The plant on one host, camera and controller on another, joined by a cable with a delay."""

import json
import os
import statistics
import subprocess

import pytest
from loop_support import CONFIG, program, run_closed_loop, stop
from two_hosts import two_hosts

from dvs_closed_loop.bags.bag import read_bag
from dvs_common.wire import topics
from dvs_common.wire.messages import parse_command, parse_image

# One run on one machine is enough for both.
pytestmark = pytest.mark.xdist_group('two_machines')

PARTNERS = ('event_camera', 'hinf_controller')
SUBNET = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}


def static_peers(hosts):
    addresses = ';'.join(host.address for host in hosts)
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': addresses}


def start_on(host, executable, domain, discovery, *arguments):
    # Without shared memory, which two machines would not have either.
    settings = {'ROS_DOMAIN_ID': str(domain), 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4', **discovery}
    return subprocess.Popen(
        host.command(program(executable), *arguments),
        env={**os.environ, **settings},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def run_across(hosts, scenario, domain, folder, processes, discovery, *options):
    """Run a parameter file across hosts; returns its folder of results."""
    plant_host, other_host = hosts
    file = ('--params-file', str(scenario))
    mode = ('-p', 'mode:=realtime') if 'realtime' in options else ()
    for executable in PARTNERS:
        arguments = ('--ros-args', *file, *mode)
        processes.append(start_on(other_host, executable, domain, discovery, *arguments))
    elsewhere = ('--output', str(folder), '--elsewhere', *PARTNERS)
    runner = start_on(plant_host, 'closed_loop', domain, discovery, *file, *elsewhere, *options)
    processes.append(runner)
    output, _ = runner.communicate(timeout=120)
    assert runner.returncode == 0, output
    for process in processes[-3:-1]:
        code, log = stop(process)
        assert code == 0, log
        assert 'Traceback' not in log
    return folder / scenario.stem


def messages_of(bag, topic):
    """Messages of a topic and the times at which they came, ns."""
    return [(m.received_ns, m.data) for m in read_bag(bag).messages if m.topic == topic]


def command_delays_ms(bag):
    """Time from a sample's luminosity to its command, as the plant's host sees them."""
    sent = {}
    for time_ns, message in messages_of(bag, topics.LUMINOSITY):
        sent.setdefault(parse_image(message).stamp_ns, time_ns)
    answers = [(parse_command(m).stamp_ns, t) for t, m in messages_of(bag, topics.COMMAND)]
    return [(time_ns - sent[stamp]) * 1e-6 for stamp, time_ns in answers]


@pytest.fixture(scope='module')
def bag_of_one_machine(new_domain, tmp_path_factory):
    folder = tmp_path_factory.mktemp('alone')
    alone = run_closed_loop('mirror_r3', new_domain(), folder, '--duration', '0.5', '--composed')
    assert alone.returncode == 0, alone.stderr
    return folder / 'mirror_r3' / 'bag'


@pytest.mark.parametrize('delay_ms', [0.0, 1.0])
def test_in_lockstep_a_delay_costs_time_but_changes_no_bit(
    delay_ms, bag_of_one_machine, domain, tmp_path, processes
):
    with two_hosts(delay_ms) as hosts:
        across = run_across(
            *(hosts, CONFIG / 'mirror_r3.yaml', domain, tmp_path / 'across', processes, SUBNET),
            *('--duration', '0.5'),
        )

    for topic in (topics.EVENTS, topics.COMMAND):
        here = [m for _, m in messages_of(bag_of_one_machine, topic)]
        assert [m for _, m in messages_of(across / 'bag', topic)] == here
        assert len(here) == 501
    # Every cycle crosses the cable twice; half of that leaves room for a recorder that lags.
    assert json.loads((across / 'result.json').read_text())['wall_seconds'] > 0.5 * delay_ms


@pytest.mark.wall_clock
def test_in_realtime_it_regulates_over_five_milliseconds(domain, tmp_path, processes):
    file = tmp_path / 'pendulum.yaml'
    text = (CONFIG / 'pendulum.yaml').read_text()
    file.write_text(text.replace('sampling_period: 0.001', 'sampling_period: 0.005'))
    with two_hosts(5.0) as hosts:
        across = run_across(
            *(hosts, file, domain, tmp_path / 'out', processes, static_peers(hosts)),
            *('--mode', 'realtime', '--duration', '4'),
        )

    result = json.loads((across / 'result.json').read_text())
    assert result['regulated']
    assert result['sector_ratio_max'] <= 1
    # Twice the cable, less what a recorder may lag behind.
    assert statistics.median(command_delays_ms(across / 'bag')) > 8
