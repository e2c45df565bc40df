"""Transitions of any node in the midst of a lockstep loop never hang it."""

import random

from loop_support import UNHURRIED, operating, ros_arguments, start, stop_all
from sensor_msgs.msg import JointState

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
MORE = 200


def test_a_lockstep_loop_goes_on_after_the_transitions_of_any_node(domain, processes):
    for executable in NODES:
        parameters = {**UNHURRIED, 'autostart': False}
        processes.append(start(executable, domain, ros_arguments(parameters)))
    draw = random.Random(1)
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 1000)

        def goes_on():
            states.clear()
            return operator.spin_until(lambda: len(states) > MORE, timeout_s=30)

        for label in ('configure', 'activate'):
            for node in draw.sample(NODES, len(NODES)):
                assert operator.transition(node, label)
        assert goes_on()
        for node in draw.sample(NODES, len(NODES)):
            for labels in (
                ('deactivate', 'activate'),
                ('deactivate', 'cleanup', 'configure', 'activate'),
            ):
                for label in labels:
                    assert operator.transition(node, label)
                assert goes_on(), (node, labels)
    stop_all(processes)
