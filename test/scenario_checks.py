"""What every lockstep scenario of config/ has to show, in every test that runs it."""

import hashlib
import json
from pathlib import Path

import pytest
from numerics import fingerprint
from rosbags.rosbag2 import Reader

from dvs_common.wire import topics

# Bytes of `events` and `command` that every scenario made in lockstep before the packages were
# rearranged: each message preceded by its length as a little-endian int32, then SHA-256. (Those of
# `pendulum` are of later: its controller is designed in balanced units since; and those of
# `printed_wall`, which is younger.) They hold where logarithms and BLAS round as on the machine
# that made them.
RECORDED = json.loads((Path(__file__).parent / 'lockstep_bytes.json').read_text())
BYTES = RECORDED['scenarios'] if RECORDED['numerics'] == fingerprint() else {}
STREAMS = (topics.LUMINOSITY, topics.STATE, topics.EVENTS, topics.COMMAND, topics.ESTIMATE)


def streams_of_bag(bag):
    """Messages of the streams that make up a run, without what was sent again."""
    streams = {topic: [] for topic in STREAMS}
    with Reader(bag) as reader:
        for connection, _, message in reader.messages():
            stream = streams.get(connection.topic.removeprefix('/'))
            # A sample that waited half a second was sent, and answered, again.
            if stream is not None and (not stream or stream[-1] != message):
                stream.append(bytes(message))
    return streams


def check_bytes(scenario, streams):
    """Require the bytes that were recorded of a whole run."""
    found = {}
    for topic in (topics.EVENTS, topics.COMMAND):
        digest = hashlib.sha256()
        for message in streams[topic]:
            digest.update(len(message).to_bytes(4, 'little') + message)
        found[topic] = {'messages': len(streams[topic]), 'sha256': digest.hexdigest()}
    assert found == BYTES.get(scenario, found)


def check_verdict(scenario, result):
    """Require what every run of a scenario has to show."""
    assert result['regulated']
    assert 0 < result['limsup_error'] < result['tolerance']
    assert 0.5 < result['sector_ratio_max'] <= 1
    assert result['h'] <= result['h_star']
    if scenario == 'paper_r3':
        # Paper, section IV-A: h*_u = 0.1562.
        assert result['h_star'] == pytest.approx(0.1562, rel=5e-3)


def check_results(folder, scenario):
    """Require verdict and figure of a run of the nodes; return the streams of its bag."""
    check_verdict(scenario, json.loads((folder / 'result.json').read_text()))
    assert (folder / 'figure.png').stat().st_size > 20_000
    return streams_of_bag(folder / 'bag')


def check_whole_run(folder, scenario):
    """Require all of a run of the nodes to the scenario's end."""
    check_bytes(scenario, check_results(folder, scenario))
    result = json.loads((folder / 'result.json').read_text())
    assert result['events'] > result['pixels']
