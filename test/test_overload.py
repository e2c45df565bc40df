"""Frames that a camera never took are counted and reported."""

import signal

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import operating, ros_arguments, start
from sensor_msgs.msg import Image
from test_health import latest

from dvs_common.wire import topics
from dvs_common.wire.messages import pack_image

WHILE_STOPPED, DEPTH = 150, 10


def test_all_frames_that_a_stopped_camera_never_took_are_counted(domain, processes):
    camera = start('event_camera', domain, ros_arguments({'mode': 'realtime'}))
    processes.append(camera)
    with operating(domain) as operator:
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)
        frames = operator.node.create_publisher(Image, 'luminosity', topics.stream_qos(DEPTH))

        sent = 0

        def send():
            nonlocal sent
            sent += 1
            frames.publish(pack_image(sent * 1_000_000, np.full((1, 3), 0.5), '64FC1'))

        assert operator.spin_until(lambda: frames.get_subscription_count() == 1)
        send()
        assert operator.spin_until(lambda: latest(health, 'event_camera'))
        camera.send_signal(signal.SIGSTOP)
        for _ in range(WHILE_STOPPED):
            send()
            operator.spin_until(lambda: False, timeout_s=0.001)
        camera.send_signal(signal.SIGCONT)
        seen = []

        def is_said():
            send()
            status = latest(health, 'event_camera')
            if status is not None:
                seen.append(status)
            return any('overload' in s.message and s.level >= DiagnosticStatus.WARN for s in seen)

        def are_counted():
            before = sent
            send()
            health.clear()
            assert operator.spin_until(lambda: latest(health, 'event_camera'))
            values = {v.key: v.value for v in latest(health, 'event_camera').values}
            lost = int(values['messages lost before they were taken'])
            return lost > WHILE_STOPPED // 2 and before <= int(values['frames']) + lost <= sent

        assert operator.spin_until(is_said), seen[-1:]
        assert operator.spin_until(are_counted)
