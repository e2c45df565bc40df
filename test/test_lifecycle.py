"""All three nodes are managed: every transition, failed ones and repeated cycles included."""

import numpy as np
import pytest
from loop_support import UNHURRIED, operating, ros_arguments, start, stop, stop_all
from sensor_msgs.msg import Image

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics

PUBLISHES = {'plant_sim': 'luminosity', 'event_camera': 'events', 'hinf_controller': 'command'}
NODES = tuple(PUBLISHES)
# What leads from each state to another; all else is refused and changes nothing.
LEADS_ON = {
    'unconfigured': {'configure'},
    'inactive': {'activate', 'cleanup'},
    'active': {'deactivate'},
}
BAD = {
    'plant_sim': {'set_point': [1.0, 1.0]},
    'event_camera': {'photoreceptor': 'signed_log', 'interpolation': 'hermite'},
    'hinf_controller': {'reference_lower': [0.6], 'reference_upper': [0.5]},
}
GOOD = {
    'plant_sim': {'set_point': [0.2321, -0.0928]},
    'event_camera': {'photoreceptor': 'log', 'interpolation': 'linear_log'},
    'hinf_controller': {'reference_lower': [0.4], 'reference_upper': [0.6]},
}


def refuses_what_does_not_apply(operator, executable, state):
    for label in sorted(set().union(*LEADS_ON.values()) - LEADS_ON[state]):
        assert not operator.transition(executable, label), label
    return operator.lifecycle_state(executable) == state


@pytest.mark.parametrize('executable', NODES)
def test_a_node_follows_every_transition_and_repeats_the_cycle(executable, domain, processes):
    process = start(executable, domain, ros_arguments({'autostart': False}))
    processes.append(process)
    with operating(domain) as operator:
        for _ in range(2):
            assert refuses_what_does_not_apply(operator, executable, 'unconfigured')
            assert operator.transition(executable, 'configure')
            assert refuses_what_does_not_apply(operator, executable, 'inactive')
            assert operator.spin_until(lambda: topics_of(operator, executable) == 1)
            assert operator.transition(executable, 'activate')
            assert refuses_what_does_not_apply(operator, executable, 'active')
            assert operator.transition(executable, 'deactivate')
            assert operator.transition(executable, 'activate')
            assert operator.transition(executable, 'deactivate')
            assert operator.lifecycle_state(executable) == 'inactive'
            assert operator.transition(executable, 'cleanup')
            assert operator.spin_until(lambda: topics_of(operator, executable) == 0)
        assert refuses_what_does_not_apply(operator, executable, 'unconfigured')
        assert operator.transition(executable, 'configure')
        assert shuts_down(operator, executable)
    code, output = stop(process)
    assert code == 0, output
    assert 'Traceback' not in output


def topics_of(operator, executable):
    return operator.node.count_publishers(PUBLISHES[executable])


def shuts_down(operator, executable):
    assert operator.transition(executable, 'shutdown')
    assert operator.lifecycle_state(executable) == 'finalized'
    assert operator.spin_until(lambda: topics_of(operator, executable) == 0)
    return not operator.transition(executable, 'configure')


def test_a_node_that_was_never_configured_can_be_shut_down(domain, processes):
    process = start('event_camera', domain, ros_arguments({'autostart': False}))
    processes.append(process)
    with operating(domain) as operator:
        assert shuts_down(operator, 'event_camera')
    code, output = stop(process)
    assert code == 0, output


@pytest.mark.parametrize('executable', NODES)
def test_a_failed_configuration_can_be_mended(executable, domain, processes):
    process = start(executable, domain, ros_arguments({'autostart': False}))
    processes.append(process)
    with operating(domain) as operator:
        assert operator.set_parameters(executable, **BAD[executable]).successful
        assert not operator.transition(executable, 'configure')
        assert operator.lifecycle_state(executable) == 'unconfigured'
        assert operator.set_parameters(executable, **GOOD[executable]).successful
        assert operator.transition(executable, 'configure')
        assert operator.transition(executable, 'activate')
        assert operator.lifecycle_state(executable) == 'active'
        assert shuts_down(operator, executable)
    code, output = stop(process)
    assert code == 0, output
    assert 'FATAL' in output.upper()
    assert 'Traceback' not in output


@pytest.mark.parametrize('executable', NODES)
def test_what_is_set_while_inactive_holds_from_the_activation_on(executable, domain, processes):
    process = start(executable, domain, ros_arguments({'autostart': False}))
    processes.append(process)
    with operating(domain) as operator:
        assert operator.transition(executable, 'configure')
        assert operator.set_parameters(executable, **BAD[executable]).successful
        assert not operator.transition(executable, 'activate')
        assert operator.lifecycle_state(executable) == 'inactive'
        assert operator.set_parameters(executable, **GOOD[executable]).successful
        assert operator.transition(executable, 'activate')
        assert operator.lifecycle_state(executable) == 'active'
        assert topics_of(operator, executable) == 1
    code, output = stop(process)
    assert code == 0, output
    assert 'Traceback' not in output


def test_a_plant_starts_where_it_was_set_to_while_inactive(domain, processes):
    plant = start('plant_sim', domain, ros_arguments({'autostart': False}))
    processes.append(plant)
    with operating(domain) as operator:
        images = operator.collect(Image, 'luminosity')
        for initial_state in ([0.5, 0.1], [0.4, 0.2]):
            assert operator.transition('plant_sim', 'configure')
            assert operator.set_parameters('plant_sim', initial_state=initial_state).successful
            assert operator.transition('plant_sim', 'activate')
            images.clear()
            assert operator.spin_until(lambda: len(images) > 0)
            y = np.frombuffer(bytes(images[-1].data))
            expected = np.dot(Scenario.from_values({}).model.output_vector, initial_state)
            assert y[0] == pytest.approx(expected, rel=1e-12)
            assert operator.transition('plant_sim', 'deactivate')
            assert operator.transition('plant_sim', 'cleanup')


def test_what_is_fixed_at_the_start_cannot_be_set(domain, processes):
    processes.append(start('event_camera', domain, ros_arguments({'autostart': False})))
    with operating(domain) as operator:
        result = operator.set_parameters('event_camera', autostart=True)

        assert not result.successful
        assert 'read-only' in result.reason
        assert operator.parameter('event_camera', 'autostart') is False


def test_the_loop_stops_and_goes_on_with_its_controller(domain, processes):
    for executable in NODES:
        processes.append(start(executable, domain, ros_arguments(UNHURRIED)))
    with operating(domain) as operator:
        commands = operator.streams[topics.COMMAND]
        assert operator.spin_until(lambda: len(commands) > 200)
        assert operator.transition('hinf_controller', 'deactivate')
        operator.spin_until(lambda: False, timeout_s=0.3)
        stopped = len(commands)
        operator.spin_until(lambda: False, timeout_s=0.5)
        assert len(commands) == stopped
        assert operator.transition('plant_sim', 'deactivate')
        assert operator.transition('event_camera', 'deactivate')
        for executable in ('hinf_controller', 'event_camera', 'plant_sim'):
            assert operator.transition(executable, 'activate')
        assert operator.spin_until(lambda: len(commands) > stopped + 200)
    stop_all(processes)
