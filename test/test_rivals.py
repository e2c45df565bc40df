"""Two nodes that publish one topic of the loop are an error that names both."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import UNHURRIED, operating, ros_arguments, start, stop
from test_health import latest

LISTENER = {'event_camera': 'hinf_controller', 'hinf_controller': 'plant_sim'}
LISTENER['plant_sim'] = 'event_camera'
TOPIC = {'event_camera': 'events', 'hinf_controller': 'command', 'plant_sim': 'luminosity'}


@pytest.mark.parametrize('executable', LISTENER)
def test_two_nodes_of_a_kind_are_an_error_with_both_names(executable, domain, processes):
    listener = start(LISTENER[executable], domain)
    processes.append(listener)
    for name in ('first', 'second'):
        arguments = ros_arguments(UNHURRIED)
        processes.append(start(executable, domain, [*arguments, '-r', f'__node:={name}']))
    rivals = f'{TOPIC[executable]} has 2 publishers: /first, /second'
    with operating(domain) as operator:
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)

        def is_named():
            status = latest(health, LISTENER[executable])
            return status and status.level >= DiagnosticStatus.ERROR and rivals in status.message

        assert operator.spin_until(is_named, timeout_s=60)
        stop(processes[-1])
        operator.forget(health)
        assert operator.spin_until(
            lambda: latest(health, LISTENER[executable]) and not is_named(), timeout_s=60
        )
    _, output = stop(listener)
    assert rivals in output
