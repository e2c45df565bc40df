"""Nodes of one process call each other while no other subscribes; the bytes stay the same."""

import hashlib
import json
import subprocess
import sys
import time
from itertools import pairwise

from loop_support import (
    CONFIG,
    UNHURRIED,
    environment,
    listening,
    ros_arguments,
    start,
    stop,
)

from dvs_common.scenario.loop_file import read_loop_values
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.stamped import stamp_of
from dvs_simulation.sampled.sampled_loop import run_sampled

DURATION = 0.3
TAPPED = """
import hashlib, json, sys
from dvs_common.node.direct_calls import DirectCalls
from dvs_closed_loop.running import composed_loop

streams, call = {}, DirectCalls.call

def tapped(self, handler, message):
    topic = next(name for name, known in self._handlers.items() if handler in known)
    streams.setdefault(topic, []).append(hashlib.sha256(message).hexdigest())
    call(self, handler, message)

DirectCalls.call = tapped
code = composed_loop.main()
print(json.dumps(streams))
sys.exit(code)
"""


def test_what_is_called_is_what_would_have_been_sent(domain):
    arguments = ros_arguments({'duration': DURATION}, CONFIG / 'mirror_r9.yaml')
    run = subprocess.run(
        [sys.executable, '-c', TAPPED, *arguments],
        env=environment(domain),
        capture_output=True,
        text=True,
        timeout=60,
    )
    values = {**read_loop_values(CONFIG / 'mirror_r9.yaml').merged(), 'duration': DURATION}
    expected = run_sampled(Scenario.from_values(values)).messages

    assert run.returncode == 0, run.stderr
    streams = json.loads(run.stdout.splitlines()[-1])
    for topic in (topics.LUMINOSITY, topics.EVENTS, topics.COMMAND):
        hashes = [hashlib.sha256(message).hexdigest() for message in expected[topic]]
        assert streams[f'/{topic}'] == hashes, topic


def test_who_subscribes_late_misses_nothing_from_then_on(domain, processes):
    loop = start('composed_loop', domain, ros_arguments(UNHURRIED))
    processes.append(loop)
    assert any('designed in' in line for line in loop.stdout)
    time.sleep(1.0)
    with listening(domain) as listener:
        commands = listener.streams[topics.COMMAND]
        assert listener.spin_until(lambda: len(commands) > 300)
    _, output = stop(loop)

    stamps = [stamp_of(message) for message in dict.fromkeys(commands)]
    assert stamps[0] > 0
    assert {after - before for before, after in pairwise(stamps)} == {1_000_000}
    assert 'refused' not in output
