"""The plant on the wall clock, with a controller that does not wait for it."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from loop_support import listening, operating, ros_arguments, start, stop
from sensor_msgs.msg import JointState
from test_health import reaches

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import Vector, pack_command
from dvs_plant_sim.plant import Plant

PERIOD_S = 0.02


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


def follows(states, command):
    """Whether the last sample follows from the one before with this input."""
    period_ns = round(PERIOD_S * 1e9)
    before = np.array(states[-2].position)
    plant = Plant(Scenario.from_values({}).model, initial_state=before, period_ns=period_ns)
    plant.advance(period_ns, command)
    return np.allclose(plant.state, states[-1].position, rtol=1e-9)


def test_a_command_that_grows_old_is_held_or_replaced_or_ends_the_run(domain, processes):
    command = np.array([-0.1])
    parameters = {
        'mode': 'realtime',
        'sampling_period': PERIOD_S,
        'duration': 0.0,
        'nonphysical_luminosity': 'clamp',
        'command_timeout': 0.3,
    }
    answers = {
        'hold': command,
        'equilibrium': Scenario.from_values({}).equilibrium.feedforward,
        'stop': None,
    }
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        states, publishers = {}, {}
        for policy in answers:
            arguments = ros_arguments({**parameters, 'stale_command': policy})
            processes.append(start('plant_sim', domain, [*arguments, '-r', f'__ns:=/{policy}']))
            states[policy] = operator.collect(JointState, f'{policy}/state', 100)
            publishers[policy] = operator.node.create_publisher(
                JointState, f'{policy}/command', topics.handshake_qos('realtime')
            )
        assert operator.spin_until(
            lambda: (
                all(states.values())
                and all(p.get_subscription_count() for p in publishers.values())
            )
        )
        for publisher in publishers.values():
            publisher.publish(pack_command(Vector(stamp_ns=0, names=('u1',), values=command)))
        for policy in ('hold', 'equilibrium'):
            warns = DiagnosticStatus.WARN
            assert reaches(operator, messages, f'{policy}/plant_sim', warns, 'command is stale')
            assert operator.spin_until(lambda p=policy: follows(states[p], answers[p])), policy
        assert operator.spin_until(lambda: processes[-1].poll() is not None)
    for policy, process in zip(answers, processes, strict=True):
        code, output = stop(process)
        assert code == (policy == 'stop')
        assert f's old (stale_command: {policy})' in output


def test_a_state_beyond_all_numbers_ends_the_plant_and_leaves_no_such_message(domain, processes):
    """Without a command it grows by e in two milliseconds."""
    parameters = {
        'mode': 'realtime',
        'sampling_period': PERIOD_S,
        'duration': 0.0,
        'state_matrix': [2.0, 10.0, 0.0, 500.0],
        'initial_state': [24.6, 0.2],
        'set_point': [24.5, 0.1],
    }
    command = pack_command(Vector(stamp_ns=0, names=('u1',), values=np.zeros(1)))
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 1000)
        publisher = operator.node.create_publisher(
            JointState, topics.COMMAND, topics.handshake_qos('realtime')
        )
        operator.node.create_timer(0.05, lambda: publisher.publish(command))
        plant = start('plant_sim', domain, ros_arguments(parameters))
        processes.append(plant)
        assert operator.spin_until(lambda: plant.poll() is not None)
    output, _ = plant.communicate()
    assert plant.returncode not in (0, None), output
    assert 'the state has left the range of numbers' in output
    assert 'Traceback' not in output
    assert len(states) > 20
    assert all(np.isfinite(state.position).all() for state in states)
