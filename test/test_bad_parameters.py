"""Bad parameters stop a node with one clear message and a non-zero exit code."""

import math
import subprocess

import pytest
from loop_support import CONFIG, environment, program, ros_arguments, run_closed_loop, start

ALL = ('plant_sim', 'event_camera', 'hinf_controller')
LOOP = ('plant_sim', 'hinf_controller')
PIXELS = ('event_camera', 'hinf_controller')

CASES = [
    (('plant_sim',), {'state_matrix': '[1.0, 2.0, 3.0]'}, 'state_matrix'),
    (('plant_sim',), {'pixel_offsets': '[0.0, 0.0, 1.0]'}, 'pixel_offsets'),
    (('plant_sim',), {'pixel_grid': '[2, 2]'}, 'pixel_grid'),
    (('plant_sim',), {'initial_state': '[0.0]'}, 'initial_state'),
    (('plant_sim',), {'set_point': '[1.0, 1.0]'}, 'nearest stabilizable set-point'),
    (PIXELS, {'event_threshold': '0.0'}, 'event_threshold = 0.0: must be'),
    (PIXELS, {'event_threshold': '-0.1'}, 'event_threshold = -0.1: must be'),
    (('event_camera',), {'log_base': '1.0'}, 'log_base'),
    (('hinf_controller',), {'tolerance': math.nan}, 'tolerance = nan'),
    (
        ('hinf_controller',),
        {'reference_lower': '[0.6]', 'reference_upper': '[0.5]'},
        'must not exceed reference_upper',
    ),
    (PIXELS, {'reference_lower': '[-0.1]', 'reference_upper': '[0.5]'}, 'reference_lower'),
    (LOOP, {'input_matrix': '[1.0, 0.0]'}, 'not stabilizable'),
    (LOOP, {'output_vector': '[1.0, 0.0]', 'state_matrix': '[2.0, 0.0, 0.0, 5.0]'}, 'detectable'),
    (ALL, {'event_treshold': '0.1'}, 'did you mean event_threshold?'),
    (LOOP, {'brightness_profile': 'none.csv'}, 'brightness_profile = none.csv: cannot be read'),
    (LOOP, {'profile_reach': '0.1'}, 'profile_reach = 0.1: needs brightness_profile'),
    (('hinf_controller',), {'method': 'magic'}, 'method = magic: must be one of'),
    (('hinf_controller',), {'command_limit': '[1.0, 2.0]'}, 'command_limit'),
    (('plant_sim',), {'state_matrix': '[1, 0.5]'}, 'wants all numbers of a list alike'),
    (('plant_sim',), {'duration': 'long'}, "duration = 'long'"),
    (PIXELS, {'event_threshold': '[]'}, 'event_threshold = []'),
]


@pytest.mark.parametrize(
    ('executable', 'parameters', 'message'),
    [(node, parameters, message) for nodes, parameters, message in CASES for node in nodes],
)
def test_bad_parameter_is_refused(executable, parameters, message, domain, processes):
    process = start(executable, domain, ros_arguments(parameters))
    processes.append(process)

    output, _ = process.communicate(timeout=60)

    assert process.returncode not in (0, None), output
    assert message in output
    assert 'Traceback' not in output
    lines = [
        line for line in output.splitlines() if 'Failed to parse global arguments' not in line
    ]
    assert len([line for line in lines if line.strip()]) == 1, output


@pytest.mark.parametrize('executable', [*ALL, 'pendulum_sim', 'composed_loop', 'packet_bridge'])
def test_a_node_prints_its_help_and_refuses_unknown_arguments(executable, domain, processes):
    asked = start(executable, domain, ['--help'])
    mistaken = start(executable, domain, ['--params-file', 'none.yaml'])
    processes += [asked, mistaken]
    output, _ = asked.communicate(timeout=30)
    assert asked.returncode == 0
    assert output.startswith(f'usage: {executable} [--ros-args')
    output, _ = mistaken.communicate(timeout=30)
    assert mistaken.returncode == 2
    assert output.startswith('cannot start: unknown argument --params-file;')
    assert len(output.splitlines()) == 1


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('event_threshold: 0.15', 'params-file'),
        ('/**:\n  ros__parameters:\n    event_treshold: 0.15\n', 'did you mean event_threshold?'),
        ('/**:\n  ros__parameters:\n    set_point: [1.0, 1.0]\n', 'not stabilizable'),
        ('{', 'is not YAML'),
    ],
)
def test_closed_loop_refuses_a_bad_file_and_leaves_earlier_results_alone(
    text, message, domain, tmp_path
):
    scenario = tmp_path / 'bad.yaml'
    scenario.write_text(text)
    earlier = [tmp_path / 'out' / 'bad' / name for name in ('result.json', 'bag/bag.mcap')]
    for file in earlier:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text('earlier')

    run = run_closed_loop(scenario, domain, tmp_path / 'out')

    assert run.returncode == 2
    assert message in run.stderr
    assert 'Traceback' not in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert [file.read_text() for file in earlier] == ['earlier'] * 2


def test_closed_loop_refuses_a_missing_file(domain, tmp_path):
    run = run_closed_loop(tmp_path / 'none.yaml', domain, tmp_path / 'out')

    assert run.returncode == 2
    assert 'cannot be read: No such file or directory' in run.stderr


@pytest.mark.parametrize('domain_id', ['233', 'abc'])
@pytest.mark.parametrize(
    ('executable', 'arguments'),
    [
        ('event_camera', []),
        ('dvs_closed_loop', ['record', '{tmp}/bag']),
        ('closed_loop', ['--params-file', str(CONFIG / 'mirror_r1.yaml'), '--output', '{tmp}/o']),
    ],
    ids=['node', 'record', 'closed_loop'],
)
def test_a_domain_that_is_none_is_refused_in_one_line(executable, arguments, domain_id, tmp_path):
    run = subprocess.run(
        [program(executable), *(argument.format(tmp=tmp_path) for argument in arguments)],
        env={**environment(0), 'ROS_DOMAIN_ID': domain_id},
        capture_output=True,
        text=True,
        timeout=60,
    )

    assert run.returncode == 2
    rule = f'ROS_DOMAIN_ID = {domain_id}: must be a whole number from 0 to 232'
    assert rule in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
