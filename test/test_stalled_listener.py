"""A listener that does not run: what it misses is kept for it, or said by who published it."""

import signal
import subprocess
import time

from loop_support import CONFIG, environment, listening, operating, program, start, stop
from sensor_msgs.msg import PointCloud2

from dvs_closed_loop.bags.bag import read_bag
from dvs_common.wire import topics

STALL_S = 1.0
DURATION_S = 2.0


def test_a_recorder_that_is_stopped_for_a_second_misses_nothing(domain, tmp_path, processes):
    with listening(domain) as listener:
        recorder = subprocess.Popen(
            [
                *(program('closed_loop'), '--params-file', str(CONFIG / 'mirror_r1.yaml')),
                *('--output', str(tmp_path), '--duration', str(DURATION_S)),
            ],
            env=environment(domain),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        processes.append(recorder)
        commands = listener.streams[topics.COMMAND]
        assert listener.spin_until(lambda: len(commands) > 100)
        recorder.send_signal(signal.SIGSTOP)
        before = len(commands)
        stalled_until = time.monotonic() + STALL_S
        # More than the middleware's shared memory and a history of 100 messages hold.
        assert listener.spin_until(
            lambda: time.monotonic() > stalled_until and len(commands) > before + 300
        )
        recorder.send_signal(signal.SIGCONT)
        output, _ = recorder.communicate(timeout=60)

    assert recorder.returncode == 0, output
    # The verdict has refused a recording in which a sample lacks one of its messages.
    received = [m.topic for m in read_bag(tmp_path / 'mirror_r1/bag').messages]
    assert received.count(topics.COMMAND) == round(DURATION_S / 1e-3) + 1


def test_a_scene_reports_a_camera_that_has_not_confirmed_its_last_frames(domain, processes):
    camera = start('event_camera', domain, ['--ros-args', '-p', 'mode:=realtime'])
    processes.append(camera)
    with operating(domain) as operator:
        packets = operator.collect(PointCloud2, topics.EVENTS)
        assert operator.spin_until(lambda: 'event_camera' in operator.node.get_node_names())
        scene = start('scene', domain, ['disc', '--size', '4x4', '--frames', '1000'])
        processes.append(scene)
        assert operator.spin_until(lambda: len(packets) > 5)
        camera.send_signal(signal.SIGSTOP)
        assert operator.spin_until(lambda: scene.poll() is not None)
        camera.send_signal(signal.SIGCONT)

    assert 'has not confirmed the last frames' in scene.communicate()[0]
    assert scene.returncode == 0
    assert stop(camera)[0] == 0
