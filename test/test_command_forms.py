"""Commands as others take them, limited: in a running loop."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Wrench
from loop_support import UNHURRIED, operating, ros_arguments, start
from test_health import NODES, latest, values

LIMITED = {'command_limit': '[5.5]', 'command_rate_limit': '[500.0]', 'command_copy': 'force.x'}


def test_a_loop_sends_its_command_as_a_wrench_and_counts_what_was_limited(domain, processes):
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        wrenches = operator.collect(Wrench, 'wrench', 4000)
        for executable in NODES:
            own = LIMITED if executable == 'hinf_controller' else {}
            processes.append(start(executable, domain, ros_arguments({**UNHURRIED, **own})))

        def counts(key):
            status = latest(messages, 'hinf_controller')
            return int(values(status)[key]) if status else 0

        assert operator.spin_until(lambda: counts('commands at command_limit') > 0)
        assert operator.spin_until(lambda: counts('commands at command_rate_limit') > 0)
        assert operator.spin_until(lambda: len(wrenches) > 100)
        forces = [wrench.force.x for wrench in wrenches]

    assert any(forces)
    assert max(map(abs, forces)) <= 5.5
    assert not any(wrench.torque.x or wrench.force.y for wrench in wrenches)


def test_each_form_has_the_topic_and_type_of_its_readers(domain, processes):
    forms = {'array': ('commands', 'Float64MultiArray'), 'linear.x': ('cmd_vel', 'Twist')}
    for number, form in enumerate(forms):
        arguments = [*ros_arguments({'command_copy': form}), '-r', f'__ns:=/loop{number}']
        processes.append(start('hinf_controller', domain, arguments))
    with operating(domain) as operator:

        def offered():
            return dict(operator.node.get_topic_names_and_types())

        for number, (topic, kind) in enumerate(forms.values()):
            name = f'/loop{number}/{topic}'
            assert operator.spin_until(lambda name=name: name in offered())
            assert offered()[name][0].endswith(f'/msg/{kind}')
