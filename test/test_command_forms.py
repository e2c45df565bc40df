"""Commands as others take them, limited: in a running loop."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Wrench
from loop_support import UNHURRIED, operating, ros_arguments, start
from test_health import NODES, latest, values

LIMITED = {'command_limit': '[5.5]', 'command_rate_limit': '[500.0]', 'command_copy': 'force.x'}


def test_a_loop_sends_its_command_as_a_wrench_and_counts_what_was_limited(domain, processes):
    with operating(domain) as operator:
        messages = operator.hear(DiagnosticArray, '/diagnostics', 100)
        wrenches = operator.hear(Wrench, 'wrench', 4000)
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
