"""Nodes with use_sim_time: their clocks follow /clock, and nothing in the loop waits for it."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import operating, ros_arguments, start, stop, stop_all
from test_health import reaches

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
DURATION_S = 3.0


def stamps_s(messages, node):
    return [
        m.header.stamp.sec + m.header.stamp.nanosec * 1e-9
        for m in messages
        if m.status[0].name == node
    ]


def test_clocks_of_nodes_are_simulated_and_the_loop_runs_to_its_end(domain, processes):
    parameters = {'use_sim_time': True, 'duration': DURATION_S, 'real_time_factor': 0.4}
    for executable in NODES:
        processes.append(start(executable, domain, ros_arguments(parameters)))
    plant, *others = processes
    with operating(domain) as operator:
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert operator.spin_until(lambda: plant.poll() is not None, timeout_s=60)
        received = list(health)
        # The clock stands still now. What a node does by the wall clock goes on.
        for node in NODES[1:]:
            assert reaches(operator, health, node, DiagnosticStatus.STALE), node
    code, output = stop(plant)
    assert code == 0, output
    assert f'run of {DURATION_S:g} s finished' in output
    stop_all(others)
    for node in NODES:
        times_s = stamps_s(received, node)
        # Before its first tick a simulated clock says 0; the wall clock is half a century on.
        assert times_s == sorted(times_s), node
        assert 0 < times_s[-1] <= DURATION_S, node
        assert len(set(times_s)) > 1, node


def test_a_clock_that_never_starts_is_named(domain, processes):
    parameters = {'use_sim_time': True, 'mode': 'realtime'}
    plant = start('plant_sim', domain, ros_arguments(parameters))
    processes.append(plant)
    with operating(domain) as operator:
        health = operator.collect(DiagnosticArray, '/diagnostics', 100)
        assert operator.spin_until(
            lambda: any('the time on /clock is still 0' in m.status[0].message for m in health)
        )
    code, output = stop(plant)
    assert code == 0, output
    assert 'use_sim_time is set, but the time on /clock is still 0' in output
