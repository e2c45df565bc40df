"""What the launch file and `closed_loop` start, without starting it."""

from pathlib import Path

import pytest
import yaml

from dvs_closed_loop.bags.streams import STREAMS
from dvs_closed_loop.running.launch_plan import ARGUMENTS, VIEWERS, launch_plan, record_command
from dvs_closed_loop.running.loop_plan import given, loop_plan, plant_program, scenario_file
from dvs_closed_loop.running.run_recorder import RECORDED
from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.wire import topics

CONFIG = Path(__file__).resolve().parents[3] / 'config'
MIRROR = CONFIG / 'mirror_r3.yaml'
PENDULUM = CONFIG / 'pendulum.yaml'


def programs(plans):
    return [(plan.package, plan.executable) for plan in plans]


def plan_of(file, **options):
    return loop_plan(load_scenario(file), file, **options)


def test_three_nodes_with_the_plant_last():
    assert programs(plan_of(MIRROR)) == [
        ('dvs_event_camera', 'event_camera'),
        ('dvs_hinf_controller', 'hinf_controller'),
        ('dvs_plant_sim', 'plant_sim'),
    ]
    assert programs(plan_of(PENDULUM))[-1] == ('dvs_plant_sim', 'pendulum_sim')


def test_nodes_elsewhere_are_left_out():
    plans = plan_of(MIRROR, elsewhere=('event_camera', 'hinf_controller'))
    assert programs(plans) == [('dvs_plant_sim', 'plant_sim')]
    with pytest.raises(ParameterError, match='elsewhere = plant_sim: must be out of'):
        plan_of(MIRROR, elsewhere=('plant_sim',))


def test_only_the_plant_is_started_inactive():
    *partners, plant = plan_of(MIRROR, plant_waits=True, parameters={'duration': 1.0})
    assert plant.parameters == {'duration': 1.0, 'autostart': False}
    assert all(plan.parameters == {'duration': 1.0} for plan in partners)


def test_composed_is_one_process_of_the_linear_plant_alone():
    (plan,) = plan_of(MIRROR, composed=True, plant_waits=True, namespace='left')
    assert plan.executable == 'composed_loop'
    assert plan.options == ('--plant-waits',)
    assert plan.namespace == '/left'
    with pytest.raises(ParameterError, match=r'plant_executable = .*: can not share a process'):
        plan_of(PENDULUM, composed=True)
    with pytest.raises(ParameterError, match='can not be given with --composed'):
        plan_of(MIRROR, composed=True, elsewhere=('event_camera',))


@pytest.mark.parametrize('name', ['plant_sim', 'a/b/c', 'dvs_plant_sim/', ''])
def test_a_plant_is_named_by_package_and_executable(name):
    with pytest.raises(ParameterError, match='must be package/executable'):
        plant_program(Scenario.from_values({'plant_executable': name}), MIRROR)


def test_a_plant_may_be_a_program_beside_its_scenario(tmp_path):
    scenario = Scenario.from_values({'plant_executable': './my_plant.py'})
    program = tmp_path / 'my_plant.py'
    with pytest.raises(ParameterError, match='is no executable file'):
        plant_program(scenario, tmp_path / 'my.yaml')
    program.write_text('#!/usr/bin/env python3')
    program.chmod(0o755)

    assert plant_program(scenario, tmp_path / 'my.yaml') == ('', str(program))
    assert loop_plan(scenario, tmp_path / 'my.yaml')[-1].name == 'my_plant.py'


def test_a_launch_starts_what_closed_loop_starts():
    plan = launch_plan(
        {
            'scenario': str(PENDULUM),
            'namespace': 'left',
            'mode': 'realtime',
            'method': 'structured',
        }
    )
    wanted = plan_of(
        PENDULUM, namespace='left', parameters=given(mode='realtime', method='structured')
    )
    assert (*plan.partners, plan.plant) == wanted
    assert plan.plant.parameters == {'mode': 'realtime', 'method': 'structured'}
    assert plan.recorder == ()
    assert plan.viewer is None


def test_every_scenario_can_be_launched_by_name():
    for file in CONFIG.glob('*.yaml'):
        assert scenario_file(file.stem).resolve() == file
        assert launch_plan({'scenario': file.stem}).plant.parameter_file.stem == file.stem
    assert launch_plan({}).plant.parameter_file.stem == 'paper_r3'


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (
            {'scenario': 'nowhere'},
            'scenario = nowhere: must be a parameter file or one of .*pendu',
        ),
        ({'mode': 'fast'}, 'mode = fast: must be one of lockstep, realtime$'),
        (
            {'viewer': 'xterm'},
            'viewer = xterm: must be one of none, rqt, plotjuggler, rviz, ',
        ),
        ({'namespace': 'a b'}, 'namespace = a b: '),
        ({'elsewhere': 'me'}, 'elsewhere = me: '),
        ({'log_level': 'loud'}, 'log_level = loud: must be one of debug'),
        ({'use_sim_time': 'yes'}, 'use_sim_time = yes: must be one of true, false'),
        ({'speed': '2'}, 'speed = 2: is not an argument'),
    ],
)
def test_a_bad_argument_is_named(arguments, message):
    with pytest.raises(ParameterError, match=message):
        launch_plan(arguments)


def test_a_recording_takes_the_loops_own_topics(tmp_path):
    folder = str(tmp_path / 'bag')
    command = record_command(folder, 'left')
    assert command[:7] == ('ros2', 'bag', 'record', '--storage', 'mcap', '--output', folder)
    assert {'/left/events', '/left/command', '/left/clock', '/diagnostics'} < set(command)
    assert {f'/left/{topic}' for topic in RECORDED if topic[0] != '/'} < set(command)
    assert '/clock' not in command
    assert '/clock' in record_command(folder, '')


def qos_of(command):
    return yaml.safe_load(
        Path(command[command.index('--qos-profile-overrides-path') + 1]).read_text()
    )


@pytest.mark.parametrize('namespace', ['', 'left'])
def test_every_recorded_topic_has_a_qos_of_its_own(namespace, tmp_path):
    command = record_command(str(tmp_path / 'bag'), namespace)
    recorded = set(command[command.index('--qos-profile-overrides-path') + 2 :])

    assert set(qos_of(command)) == recorded
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_the_recorders_qos_fits_what_the_nodes_offer(mode, tmp_path):
    for name, qos in qos_of(record_command(str(tmp_path / 'bag'), '')).items():
        topic = name if name in STREAMS else name[1:]
        offered = STREAMS[topic].offered_qos
        if topic in (topics.EVENTS, topics.COMMAND):
            offered = topics.handshake_qos(mode)
        assert set(qos) == {'history', 'depth', 'reliability', 'durability'}
        assert qos['depth'] >= offered.depth
        if qos['reliability'] == 'reliable':
            assert offered.reliability.name == 'RELIABLE'
        if qos['durability'] == 'transient_local':
            assert offered.durability.name == 'TRANSIENT_LOCAL'


def test_time_and_log_are_those_of_the_launch():
    arguments = {'params_file': str(PENDULUM), 'use_sim_time': 'true', 'log_level': 'warn'}
    plan = launch_plan(arguments)

    for node in (*plan.partners, plan.plant):
        assert node.parameters == {'use_sim_time': True}
        assert node.arguments[-2:] == ['--log-level', 'warn']
        assert node.parameter_file == PENDULUM
    assert '--log-level' not in launch_plan({}).plant.arguments


@pytest.mark.parametrize('viewer', VIEWERS)
def test_a_viewer_is_no_part_of_the_loop(viewer):
    plan = launch_plan({'viewer': viewer})
    assert plan.viewer.executable == VIEWERS[viewer].executable
    assert plan.viewer not in (*plan.partners, plan.plant)


def test_every_argument_has_a_description():
    assert all(len(argument.description) > 10 for argument in ARGUMENTS)
