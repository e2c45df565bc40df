"""The sampled mode gives the bytes of the ROS loop."""

import numpy as np
import pytest
from loop_support import CONFIG, run_closed_loop
from rosbags.rosbag2 import Reader

from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_simulation.sampled.sampled_loop import run_sampled

STREAMS = (topics.LUMINOSITY, topics.STATE, topics.EVENTS, topics.COMMAND, topics.ESTIMATE)


def streams_of_bag(path):
    streams = {topic: [] for topic in STREAMS}
    with Reader(path) as reader:
        for connection, _, message in reader.messages():
            topic = connection.topic.removeprefix('/')
            if topic in streams:
                streams[topic].append(bytes(message))
    return streams


@pytest.mark.parametrize('name', ['mirror_r9', 'paper_r3'])
def test_sampled_mode_gives_the_bytes_of_the_nodes(name, domain, tmp_path):
    run = run_closed_loop(name, domain, tmp_path, '--duration', '0.5', '--composed')
    recorded = streams_of_bag(tmp_path / name / 'bag')
    assert len(recorded[topics.COMMAND]) == 501, run.stdout + run.stderr
    assert 'Warning' not in run.stdout + run.stderr

    sampled = run_sampled(load_scenario(CONFIG / f'{name}.yaml').replace(duration=0.5))

    for topic in STREAMS:
        assert sampled.messages[topic] == recorded[topic], topic
    assert len(np.unique(recorded[topics.COMMAND])) > 100
