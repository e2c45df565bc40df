"""What every lockstep scenario of config/ has to show, in every test that runs it."""

import hashlib
import json
from pathlib import Path

import pytest
from numerics import fingerprint
from rosbags.rosbag2 import Reader

# Bytes of `events` and `command` that every scenario made in lockstep before the packages were
# rearranged: each message preceded by its length as a little-endian int32, then SHA-256. (Those of
# `pendulum` are of later: its controller is designed in balanced units since; and those of
# `printed_wall`, which is younger.) They hold where logarithms and BLAS round as on the machine
# that made them.
RECORDED = json.loads((Path(__file__).parent / 'lockstep_bytes.json').read_text())
BYTES = RECORDED['scenarios'] if RECORDED['numerics'] == fingerprint() else {}


def bytes_of(bag):
    streams = {
        topic: {'messages': 0, 'sha256': hashlib.sha256()} for topic in ('events', 'command')
    }
    last = {}
    with Reader(bag) as reader:
        for connection, _, message in reader.messages():
            topic = connection.topic.removeprefix('/')
            stream = streams.get(topic)
            # A sample that waited half a second was sent, and answered, again.
            if stream and last.get(topic) != message:
                last[topic] = message
                stream['messages'] += 1
                stream['sha256'].update(len(message).to_bytes(4, 'little') + bytes(message))
    return {
        name: {**stream, 'sha256': stream['sha256'].hexdigest()}
        for name, stream in streams.items()
    }


def check_scenario(output, scenario):
    result = json.loads((output / scenario / 'result.json').read_text())
    assert result['regulated']
    assert 0 < result['limsup_error'] < result['tolerance']
    assert 0.5 < result['sector_ratio_max'] <= 1
    assert result['events'] > result['pixels']
    assert result['h'] <= result['h_star']
    assert (output / scenario / 'figure.png').stat().st_size > 20_000
    bytes_now = bytes_of(output / scenario / 'bag')
    assert bytes_now == BYTES.get(scenario, bytes_now)
    if scenario == 'paper_r3':
        # Paper, section IV-A: h*_u = 0.1562.
        assert result['h_star'] == pytest.approx(0.1562, rel=5e-3)
