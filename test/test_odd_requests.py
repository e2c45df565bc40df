"""Requests that make no sense are refused, and the node goes on."""

import subprocess

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from loop_support import CONFIG, environment, operating, program, start, stop
from sensor_msgs.msg import JointState
from test_changing_parameters import NODES, start_loop


@pytest.mark.parametrize('node', NODES)
def test_an_impossible_transition_is_answered_and_survived(node, domain, processes):
    process = start(node, domain)
    processes.append(process)
    with operating(domain) as operator:
        assert operator.lifecycle_state(node) == 'active'
        for transition in (Transition.TRANSITION_ACTIVATE, 99):
            request = ChangeState.Request(transition=Transition(id=transition))
            assert not operator.call(ChangeState, f'{node}/change_state', request).success
        assert operator.lifecycle_state(node) == 'active'
        assert operator.transition(node, 'deactivate')
    code, output = stop(process)

    assert code == 0, output
    assert 'transition 99 refused' in output
    assert 'Traceback' not in output


def test_a_controller_that_rests_in_the_midst_goes_on(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 100)
        assert operator.spin_until(lambda: len(states) > 300, timeout_s=60)
        assert operator.transition('hinf_controller', 'deactivate')
        operator.spin_until(lambda: False, timeout_s=1.0)
        assert operator.transition('hinf_controller', 'activate')
        seen = len(states)
        assert operator.spin_until(lambda: len(states) > seen + 300, timeout_s=60)


def test_a_tiny_pace_can_be_taken_back(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 100)
        assert operator.spin_until(lambda: len(states) > 100, timeout_s=60)
        for factor in (1e-5, 1e-300):
            assert operator.set_parameters('plant_sim', real_time_factor=factor).successful
            operator.spin_until(lambda: False, timeout_s=1.0)
            seen = len(states)
            assert operator.set_parameters('plant_sim', real_time_factor=0.0).successful
            assert operator.spin_until(lambda seen=seen: len(states) > seen + 100, timeout_s=30)


def test_a_second_loop_in_the_domain_is_refused_and_leaves_earlier_results_alone(
    domain, processes, tmp_path
):
    first = start('plant_sim', domain)
    processes.append(first)
    with operating(domain) as operator:
        assert operator.lifecycle_state('plant_sim') == 'active'
    earlier = tmp_path / 'out' / 'mirror_r3' / 'bag' / 'bag.mcap'
    earlier.parent.mkdir(parents=True)
    earlier.write_text('earlier')
    second = subprocess.run(
        [program('closed_loop'), '--params-file', str(CONFIG / 'mirror_r3.yaml')],
        env=environment(domain),
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=60,
    )

    assert second.returncode == 1
    assert second.stderr.count('a plant_sim runs in this ROS domain already') == 1
    assert first.poll() is None
    assert earlier.read_text() == 'earlier'
    assert list(earlier.parents[1].iterdir()) == [earlier.parent]
