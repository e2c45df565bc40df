"""A loop that runs for long: counts equal to the last bit, and memory that does not grow.

`scripts/test.sh --long` runs an hour of simulated time with ten million events.
"""

from pathlib import Path

import numpy as np
import pytest
from loop_support import operating, ros_arguments, start, stop_all
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Empty
from test_kill_rounds import stamp_of

from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_common.wire.events import parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.keyframe import parse_keyframe
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller

NODES = ('event_camera', 'hinf_controller', 'plant_sim')
# The mirror example seen by 100 pixels, kept in motion by noise on its input.
SCENARIO = """/**:
  ros__parameters:
    state_matrix: [2.0, 10.0, 0.0, 5.0]
    input_matrix: [1.0, 1.0]
    output_vector: [0.894427190999916, 0.447213595499958]
    pixel_grid: [10, 10]
    pixel_pitch: [0.0005, 0.0, 0.0, 0.0005]
    pixel_offsets: []
    initial_state: [0.4821, 0.1572]
    set_point: [0.2321, -0.0928]
    set_point_tolerance: 0.001
    tolerance: 0.05
    event_threshold: 0.02
    reference_uncertainty: 0.002
    method: unstructured
    sampling_period: 0.02
    input_disturbance: 0.1
    duration: 0.0
"""


class Count:
    """Adds up the events of a loop on the way; keeps the sums of the last packets."""

    def __init__(self, pixels, width):
        self.counts = np.zeros(pixels, np.int64)
        self.width = width
        self.index = IndexWatch()
        self.stamp_ns = 0
        self.kept = {}
        self.keeps = False

    def take(self, message):
        packet = parse_events(message)
        if packet.stamp_ns in (self.stamp_ns, 0) and self.index.events:
            return
        self.index.take(packet)
        self.stamp_ns = packet.stamp_ns
        events = packet.events
        pixels = events['y'].astype(np.intp) * self.width + events['x']
        self.counts += np.bincount(
            pixels, weights=events['polarity'], minlength=self.counts.size
        ).astype(np.int64)
        if self.keeps:
            self.kept[packet.stamp_ns] = self.counts.copy()


def memory_mb(process):
    status = Path(f'/proc/{process.pid}/status').read_text()
    return int(status.split('VmRSS:')[1].split()[0]) / 1024


def run_for(seconds, folder, domain, processes):
    """Events of the run, and by how many MB each process has grown since a tenth of it."""
    file = folder / 'long.yaml'
    file.write_text(SCENARIO)
    scenario = load_scenario(file)
    rows, width = scenario.pixels.pixel_grid
    with operating(domain) as operator:
        count = Count(rows * width, width)
        qos = topics.handshake_qos('lockstep', topics.LISTENER_DEPTH)
        operator.node.create_subscription(PointCloud2, 'events', count.take, qos, raw=True)
        keyframes = operator.collect(PointCloud2, 'keyframe', topics.latched_qos(depth=1))
        raw_keyframes = []
        operator.node.create_subscription(
            PointCloud2, 'keyframe', raw_keyframes.append, topics.latched_qos(depth=1), raw=True
        )
        for name in NODES:
            processes.append(start(name, domain, ros_arguments(file=file)))

        def reaches(share):
            return operator.spin_until(
                lambda: count.stamp_ns >= share * seconds * 1e9, timeout_s=60 + 2 * seconds
            )

        assert reaches(0.1)
        before = [memory_mb(process) for process in processes]
        assert reaches(1.0)
        grown = [memory_mb(p) - b for p, b in zip(processes, before, strict=True)]

        count.keeps = True
        estimates = operator.collect(JointState, 'estimate', topics.stream_qos())
        ask = operator.node.create_publisher(Empty, 'keyframe_request', topics.stream_qos())
        assert operator.spin_until(lambda: ask.get_subscription_count() > 0)
        keyframes.clear()
        raw_keyframes.clear()
        ask.publish(Empty())
        assert operator.spin_until(
            lambda: (
                any(stamp_of(k) in count.kept for k in keyframes)
                and any(stamp_of(e) in count.kept for e in estimates)
            )
        )
    keyframe = next(k for k in map(parse_keyframe, raw_keyframes) if k.stamp_ns in count.kept)
    found = next(e for e in estimates if stamp_of(e) in count.kept)
    stop_all(processes)

    assert (count.index.lost, count.index.restarts) == (0, 0)
    assert np.array_equal(keyframe.counts, count.kept[keyframe.stamp_ns])
    # The estimate of a controller that knows where the references began, and these counts.
    fresh = event_controller(design_from_scenario(scenario), scenario)
    fresh.take_keyframe(keyframe)
    known = fresh.references.intervals
    expected = known.signs * known.first * np.exp(count.kept[stamp_of(found)] * known.log_step)
    assert np.array_equal(np.array(found.position), expected)
    return count.index.events, grown


def test_counts_and_estimates_of_a_run_agree_to_the_last_bit(domain, processes, tmp_path):
    events, grown = run_for(20.0, tmp_path, domain, processes)

    assert events > 20_000
    assert max(grown) < 50, grown


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_an_hour_with_ten_million_events(domain, processes, tmp_path):
    events, grown = run_for(3600.0, tmp_path, domain, processes)
    print(f'{events} events; growth since a tenth of the run, MB: {grown}')

    assert events > 10_000_000
    # The history of a publisher keeps 4000 packets, each place as large as its largest so far.
    assert max(grown) < 20, grown
