"""/diagnostics: each level is reached, for a reason."""

import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import UNHURRIED, environment, operating, ros_arguments, start, stop

# A controller whose certificate cannot be worked out, for pixels that it is not designed for.
WITHOUT_CERTIFICATE = """
import numpy as np
from dvs_hinf_controller.design import live_certificate
from dvs_hinf_controller.hinf_controller_node import main

def measure(problem, controller):
    raise np.linalg.LinAlgError('SVD did not converge')

live_certificate.measure = measure
live_certificate.unmasked = lambda count, masked: np.arange(count) > 0
main()
"""
NODES = ('plant_sim', 'event_camera', 'hinf_controller')


def latest(messages, node):
    found = [m.status[0] for m in messages if m.status[0].name == node]
    return found[-1] if found else None


def reaches(operator, messages, node, level, text='', timeout_s=30):
    def condition():
        status = latest(messages, node)
        return status is not None and status.level == level and text in status.message

    return operator.spin_until(condition, timeout_s)


def values(status):
    return {pair.key: pair.value for pair in status.values}


def test_a_running_loop_is_ok_and_goes_stale_without_its_plant(domain, processes):
    for executable in NODES:
        arguments = ros_arguments({**UNHURRIED, 'event_threshold': 0.1})
        processes.append(start(executable, domain, arguments))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        for node in NODES:
            assert reaches(operator, messages, node, DiagnosticStatus.OK, 'ok'), node

        def figure(node, key):
            return float(values(latest(messages, node))[key])

        assert operator.spin_until(lambda: figure('plant_sim', 'cycles/s') > 10)
        assert operator.spin_until(lambda: 0 < figure('event_camera', 'share of ON') < 1)
        assert operator.spin_until(lambda: figure('event_camera', 'Mev/s') > 0)
        assert operator.spin_until(lambda: figure('plant_sim', 'real-time factor') > 0.01)
        assert 'age of command [s]' in values(latest(messages, 'plant_sim'))

        def rests_on():
            return values(latest(messages, 'hinf_controller'))['estimator']

        assert operator.spin_until(lambda: rests_on() == 'exact')
        controller = values(latest(messages, 'hinf_controller'))
        assert controller['h <= h*'] == 'True'
        assert float(controller['h_certified']) < float(controller['h* (published)'])
        assert controller['events lost'] == '0'
        assert controller['certificate'].startswith('certified now')

        stop(processes[0])
        for node in NODES[1:]:
            assert reaches(operator, messages, node, DiagnosticStatus.STALE), node


def test_a_plant_without_partners_is_stale(domain, processes):
    processes.append(start('plant_sim', domain))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert reaches(operator, messages, 'plant_sim', DiagnosticStatus.STALE, 'no command')


def test_a_threshold_above_h_certified_is_a_warning(domain, processes):
    for executable in NODES:
        arguments = ros_arguments({**UNHURRIED, 'event_threshold': 0.15})
        processes.append(start(executable, domain, arguments))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert reaches(
            operator, messages, 'hinf_controller', DiagnosticStatus.WARN, 'not certified'
        )


def test_a_certificate_that_cannot_be_worked_out_is_named_and_the_loop_goes_on(domain, processes):
    controller = subprocess.Popen(
        [sys.executable, '-c', WITHOUT_CERTIFICATE],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    processes.append(controller)
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)

        def figures():
            status = latest(messages, 'hinf_controller')
            return {} if status is None else values(status)

        assert operator.spin_until(
            lambda: figures().get('h_certified') == 'none: SVD did not converge'
        )
        assert figures()['h <= h_certified'] == 'none: SVD did not converge'
        # It goes on reporting.
        messages.clear()
        assert operator.spin_until(lambda: len(messages) > 1)
    code, output = stop(controller)
    assert code == 0
    assert 'no certificate of the pixels that are left: SVD did not converge' in output


def test_luminosity_without_logarithm_is_an_error(domain, processes):
    # The set-point of the printed example is dark: y would be negative there.
    parameters = {
        'duration': 0.0,
        'initial_state': '[0.0179, 0.3428]',
        'set_point': '[-0.2321, 0.0928]',
        'nonphysical_luminosity': 'publish',
    }
    for executable in NODES:
        processes.append(start(executable, domain, ros_arguments(parameters)))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        for node in ('plant_sim', 'event_camera'):
            assert reaches(operator, messages, node, DiagnosticStatus.ERROR, 'luminosity'), node
