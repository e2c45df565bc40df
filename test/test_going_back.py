"""Time that goes back: plant, camera and controller begin anew, and the loop is whole again."""

import math
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from loop_support import operating, ros_arguments, start, stop_all
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from test_health import latest, values

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import parse_command

NODES = ('event_camera', 'hinf_controller', 'plant_sim')
PERIOD_S = 0.01


@pytest.fixture
def stepped_clock(tmp_path):
    """Environment of processes whose wall clock is off, and what sets by how much (s)."""
    library = next(Path('/usr/lib').glob('*/faketime/libfaketimeMT.so.1'), None)
    if library is None:
        pytest.skip('no libfaketime here: apt-get install libfaketime')
    offset = tmp_path / 'offset'

    def set_clock(offset_s):
        # Never half written.
        (tmp_path / 'new').write_text(f'{offset_s:+f}\n')
        (tmp_path / 'new').rename(offset)

    set_clock(0.0)
    environment = {
        'LD_PRELOAD': str(library),
        'FAKETIME_TIMESTAMP_FILE': str(offset),
        'FAKETIME_DONT_FAKE_MONOTONIC': '1',
        'FAKETIME_NO_CACHE': '1',
    }
    return environment, set_clock


def start_loop(domain, processes, **parameters):
    for executable in NODES:
        arguments = ros_arguments({'duration': 0.0, **parameters})
        processes.append(start(executable, domain, arguments))


def stamp_s(message):
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def from_sample_0(commands):
    """Commands of a run without the last ones of a former run, each once."""
    stamps = [parse_command(command).stamp_ns for command in commands]
    return list(dict.fromkeys(commands[stamps.index(0) :])) if 0 in stamps else []


def is_exact(messages):
    status = latest(messages, 'hinf_controller')
    return status is not None and values(status)['estimator'] == 'exact'


def test_a_lockstep_plant_that_starts_again_gets_the_same_commands(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        commands = operator.streams[topics.COMMAND]
        assert operator.spin_until(lambda: len(commands) > 100)
        runs = []
        for _ in range(2):
            assert operator.transition('plant_sim', 'deactivate')
            operator.forget(commands)
            assert operator.transition('plant_sim', 'activate')
            assert operator.spin_until(
                lambda: len(commands) > 300 and len(from_sample_0(commands)) > 300
            )
            runs.append(from_sample_0(commands)[:300])
        messages.clear()
        assert operator.spin_until(lambda: is_exact(messages))
    camera, controller, _ = stop_all(processes)

    assert runs[0] == runs[1]
    assert 'sensor started again' in camera
    assert 'stamps have started again: so do the estimator and K' in controller


@pytest.mark.parametrize(
    ('jump_s', 'said'),
    [
        (-95.0, 'the clock went back: the plant starts again'),
        (3600.0, 'the clock went forward by 36'),
    ],
)
def test_a_clock_that_steps_starts_a_realtime_loop_again(jump_s, said, domain, processes):
    start_loop(
        domain,
        processes,
        mode='realtime',
        use_sim_time=True,
        sampling_period=PERIOD_S,
        nonphysical_luminosity='clamp',
    )
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        states = operator.collect(JointState, 'state', 100)
        clock = operator.node.create_publisher(Clock, '/clock', topics.clock_qos())
        time_s = 100.0

        def tick():
            nonlocal time_s
            time_s += PERIOD_S
            seconds = math.floor(time_s)
            message = Clock()
            message.clock.sec, message.clock.nanosec = seconds, int((time_s - seconds) * 1e9)
            clock.publish(message)

        operator.node.create_timer(PERIOD_S, tick)
        assert operator.spin_until(lambda: is_exact(messages) and len(states) > 150)
        before_s = stamp_s(states[-1])
        time_s += jump_s
        assert operator.spin_until(lambda: abs(stamp_s(states[-1]) - before_s) > 15)
        again = next(s for s in states if abs(stamp_s(s) - before_s) > 15)
        operator.forget(messages)
        seen = len(states)
        assert operator.spin_until(lambda: is_exact(messages) and len(states) > seen + 100)
        stamps = [stamp_s(s) for s in states[seen:]]
    camera, controller, plant = stop_all(processes)

    # A command on its way when the clock went back may still have moved it, and some samples may
    # have gone by; it is far from the set-point (0.25 away in each state), where it was before.
    assert again.position == pytest.approx(Scenario.from_values({})['initial_state'], abs=0.1)
    assert stamps == sorted(stamps)
    assert said in plant and 'FATAL' not in plant
    if jump_s < 0:
        assert 'sensor started again' in camera
        assert 'stamps have started again: so do the estimator and K' in controller


def test_a_loop_outlives_steps_of_the_machines_clock(domain, processes, stepped_clock):
    """All three processes take their time from the clock that `date` and NTP set."""
    environment, set_clock = stepped_clock
    parameters = {
        'mode': 'realtime',
        'sampling_period': PERIOD_S,
        'nonphysical_luminosity': 'clamp',
        'duration': 0.0,
    }
    for executable in NODES:
        processes.append(start(executable, domain, ros_arguments(parameters), **environment))
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        states = operator.collect(JointState, 'state', 100)
        assert operator.spin_until(lambda: is_exact(messages) and len(states) > 150)
        for offset_s in (-3600.0, 0.0):
            before_s = stamp_s(states[-1])
            set_clock(offset_s)
            assert operator.spin_until(lambda b=before_s: abs(stamp_s(states[-1]) - b) > 1000)
            operator.forget(messages)
            seen = len(states)
            assert operator.spin_until(lambda n=seen: is_exact(messages) and len(states) > n + 100)
    camera, controller, plant = stop_all(processes)

    assert all(math.isfinite(number) for state in states for number in state.position)
    assert plant.count('the clock went back') == 1
    assert plant.count('the clock went forward by 36') == 1
    for output in (camera, controller, plant):
        assert 'nan' not in output.lower()
        assert 'Warning' not in output


def test_a_controller_that_is_deactivated_leaves_the_input_that_holds(domain, processes):
    start_loop(
        domain,
        processes,
        mode='realtime',
        sampling_period=PERIOD_S,
        nonphysical_luminosity='clamp',
    )
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)
        commands = operator.collect(JointState, 'command', topics.handshake_qos('realtime'))
        assert operator.spin_until(lambda: len(commands) > 20)
        assert operator.transition('hinf_controller', 'deactivate')
        operator.spin_until(lambda: False, timeout_s=0.5)
        received = len(commands)
        operator.spin_until(lambda: False, timeout_s=0.5)
        assert len(commands) == received
        assert operator.spin_until(lambda: latest(messages, 'plant_sim') is not None)
        figures = values(latest(messages, 'plant_sim'))
    stop_all(processes)

    holding = Scenario.from_values({}).equilibrium.feedforward
    assert commands[-1].effort == pytest.approx(holding)
    assert not np.allclose(commands[-2].effort, holding)
    assert float(figures['worst sampling jitter [ms]']) > 0
    assert float(figures['samples skipped']) >= 0
