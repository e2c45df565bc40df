"""What can sensibly change while the loop runs does; the rest is refused with a reason."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from loop_support import UNHURRIED, operating, ros_arguments, start, stop, stop_all
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import Image, JointState
from test_health import latest, values

from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.sector import sector
from dvs_simulation.judging.measures import size_of

NODES = ('plant_sim', 'event_camera', 'hinf_controller')
# On the line of stabilizable set-points, brighter than the scenario's.
OTHER_SET_POINT = [0.3, -0.12]


def start_loop(domain, processes, **parameters):
    for executable in NODES:
        arguments = ros_arguments({**UNHURRIED, **parameters})
        processes.append(start(executable, domain, arguments))


def settle(operator, states, samples=900):
    seen = len(states)
    assert operator.spin_until(lambda: len(states) > seen + samples, timeout_s=60)


def largest_error(states, set_point):
    recent = np.array([np.array(state.position) for state in states[-300:]])
    return size_of(recent - np.array(set_point)).max()


def test_a_new_set_point_is_reached_and_a_bad_one_changes_nothing(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 100)
        settle(operator, states)
        assert largest_error(states, [0.2321, -0.0928]) < 0.05

        refused = operator.set_parameters('hinf_controller', set_point=[1.0, 1.0])
        assert not refused.successful
        assert 'nearest stabilizable set-point' in refused.reason
        kept = operator.parameter('hinf_controller', 'set_point')
        assert list(kept) == list(Scenario.from_values({})['set_point'])
        settle(operator, states, 300)
        assert largest_error(states, [0.2321, -0.0928]) < 0.05

        assert operator.set_parameters('hinf_controller', set_point=OTHER_SET_POINT).successful
        settle(operator, states)
        assert largest_error(states, OTHER_SET_POINT) < 0.05
        assert largest_error(states, [0.2321, -0.0928]) > 0.05


def test_a_node_starts_from_its_own_dump(domain, processes, tmp_path):
    """`ros2 param dump` writes empty lists, and rclpy reads them as values without a type."""
    dump = tmp_path / 'dump.yaml'
    dump.write_text(
        '/event_camera:\n  ros__parameters:\n    autostart: true\n    event_threshold: 0.12\n'
        '    reference_lower: []\n    reference_upper: []\n    use_sim_time: false\n'
    )
    camera = start('event_camera', domain, ros_arguments(file=dump))
    processes.append(camera)
    with operating(domain) as operator:
        assert operator.parameter('event_camera', 'event_threshold') == 0.12
        assert list(operator.parameter('event_camera', 'reference_lower')) == []
        assert operator.lifecycle_state('event_camera') == 'active'
    code, output = stop(camera)
    assert code == 0, output
    assert output == ''


def test_all_parameters_are_given_at_once_as_for_ros2_param_dump(domain, processes):
    for executable in NODES:
        processes.append(start(executable, domain))
    with operating(domain) as operator:
        for node in NODES:
            listed = operator.call(
                ListParameters, f'{node}/list_parameters', ListParameters.Request()
            )
            names = listed.result.names
            answer = operator.call(
                GetParameters, f'{node}/get_parameters', GetParameters.Request(names=names)
            )
            given = dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))

            assert {spec.name for spec in SCHEMA.of_node(node)} <= set(given)
            assert None not in given.values()

            # As `ros2 param load` sets a dump: every value again, the fixed ones too.
            request = SetParameters.Request()
            request.parameters = [
                Parameter(name=name, value=value)
                for name, value in zip(names, answer.values, strict=True)
            ]
            loaded = operator.call(SetParameters, f'{node}/set_parameters', request)
            assert [r.reason for r in loaded.results if not r.successful] == []
            refused = operator.set_parameters(node, autostart=False)
            assert 'read-only' in refused.reason
        assert list(given['reference_lower']) == []
        assert operator.set_parameters('event_camera', display_rate=20.0).successful
        refused = operator.set_parameters('event_camera', reference_lower=[0.1, 0.1])
        assert 'can only change while the node is not active' in refused.reason


def test_a_new_threshold_keeps_the_estimate_in_its_sector(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        luminosities = operator.collect(Image, 'luminosity', 100)
        estimates = operator.collect(JointState, 'estimate', 100)
        settle(operator, luminosities, 800)
        refused = operator.set_parameters('hinf_controller', event_threshold=0.1)
        assert not refused.successful
        assert 'changes on event_camera' in refused.reason

        for threshold in (0.08, 0.12):
            assert operator.set_parameters('event_camera', event_threshold=threshold).successful
            settle(operator, luminosities, 800)
            bound = sector(
                Scenario.from_values({}).model_reference_bounds,
                event_threshold=threshold,
                log_base=np.e,
            ).error_bound
            # Samples and estimates share no stamp, so a whole limit cycle of each is compared.
            y = np.array([np.frombuffer(image.data) for image in luminosities[-600:]])
            z = np.array([estimate.position for estimate in estimates[-600:]])
            assert np.all(z.max(0) <= (1 + bound) * y.max(0))
            assert np.all(z.min(0) >= (1 - bound) * y.min(0))
    *others, output = stop_all(processes)
    assert not any('the estimate is wrong' in text for text in (*others, output))
    assert 'goes from h = 0.08 to 0.12' in output


def test_what_is_fixed_while_active_is_refused_as_a_whole(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 100)
        settle(operator, states, 200)
        refused = operator.set_parameters('plant_sim', real_time_factor=2.0, sampling_period=0.01)
        assert not refused.successful
        assert 'sampling_period can only change while the node is not active' in refused.reason
        wrong = operator.set_parameters('plant_sim', real_time_factor=-1.0)
        assert not wrong.successful
        kept = {'sampling_period': Scenario.from_values({})['sampling_period'], **UNHURRIED}
        for name in ('real_time_factor', 'sampling_period'):
            assert operator.parameter('plant_sim', name) == kept[name]

        # At a twentieth of real time, 1 kHz samples come at 50 Hz.
        assert operator.set_parameters('plant_sim', real_time_factor=0.05).successful
        operator.spin_until(lambda: False, timeout_s=0.3)
        before = len(states)
        operator.spin_until(lambda: False, timeout_s=1.0)
        assert 20 < len(states) - before < 80


def test_tolerance_and_display_change_on_the_way(domain, processes):
    start_loop(domain, processes)
    with operating(domain) as operator:
        messages = operator.collect(DiagnosticArray, '/diagnostics', 100)

        def promised():
            status = latest(messages, 'hinf_controller')
            return None if status is None else float(values(status)['h* (published)'])

        assert operator.spin_until(lambda: promised() is not None)
        before = promised()
        refused = operator.set_parameters('hinf_controller', tolerance=-1.0)
        assert not refused.successful
        assert 'tolerance' in refused.reason
        assert operator.parameter('hinf_controller', 'tolerance') == 0.05
        assert operator.set_parameters('hinf_controller', tolerance=0.1).successful
        assert operator.spin_until(lambda: promised() > before)

        pictures = operator.collect(Image, 'event_image', 100)
        for rate, period_ms in ((100.0, 10), (250.0, 4)):
            assert operator.set_parameters('event_camera', display_rate=rate).successful
            operator.forget(pictures)
            assert operator.spin_until(lambda: len(pictures) > 5)
            stamps_ms = [
                p.header.stamp.sec * 1000 + p.header.stamp.nanosec // 10**6 for p in pictures
            ]
            assert set(np.diff(stamps_ms)) == {period_ms}


def test_the_estimator_follows_a_camera_with_another_threshold(domain, processes):
    processes.append(start('plant_sim', domain, ros_arguments(UNHURRIED)))
    processes.append(start('event_camera', domain, ros_arguments({'event_threshold': 0.1})))
    processes.append(start('hinf_controller', domain))
    with operating(domain) as operator:
        states = operator.collect(JointState, 'state', 100)
        settle(operator, states, 1000)
        assert largest_error(states, [0.2321, -0.0928]) < 0.05
    _, output = stop(processes[-1])
    assert 'event_camera goes from h = 0.15 to 0.1' in output
