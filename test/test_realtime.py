"""The plant on the wall clock, with a controller that does not wait for it."""

import numpy as np
from loop_support import listening, ros_arguments, start, stop
from sensor_msgs.msg import JointState

from dvs_interfaces import topics
from dvs_interfaces.messages import Vector, pack_command


def test_a_command_may_come_before_the_first_sample(domain, processes):
    command = pack_command(Vector(stamp_ns=0, names=('u1',), values=np.zeros(1)))
    with listening(domain) as listener:
        publisher = listener.node.create_publisher(
            JointState, topics.COMMAND, topics.handshake_qos('realtime')
        )
        listener.node.create_timer(0.05, lambda: publisher.publish(command))
        parameters = {'mode': 'realtime', 'sampling_period': 1.0, 'duration': 1.0}
        plant = start('plant_sim', domain, ros_arguments(parameters))
        processes.append(plant)
        assert listener.spin_until(lambda: plant.poll() is not None)
    code, output = stop(plant)

    assert code == 0, output
    assert 'run of 1 s finished' in output
