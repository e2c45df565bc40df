"""Parameter files keyed as ROS 2 keys them: by name, full name, wildcard and namespace."""

from contextlib import contextmanager

import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.node import Node

from dvs_common.errors import ParameterError
from dvs_common.scenario.loop_file import read_loop_values
from dvs_common.scenario.nodes import CAMERA, CONTROLLER, PLANT
from dvs_common.scenario.parameter_file import Section, read_parameter_file
from dvs_common.scenario.scenario import load_scenario

KEYS = (
    '/**',
    '/*',
    'plant_sim',
    '/plant_sim',
    '/**/plant_sim',
    '/*/plant_sim',
    '/left/**',
    '/left/*',
    '/left/plant_sim',
    'left/plant_sim',
    '/**/left/plant_sim',
    '/cell/left/plant_sim',
    '/left/event_camera',
)
NAMESPACES = ('', '/left', '/cell/left')


def write(path, sections):
    lines = []
    for key, values in sections:
        inner = ', '.join(f'{name}: {value}' for name, value in values.items())
        lines.append(f'{key}:\n  ros__parameters: {{{inner}}}\n')
    path.write_text(''.join(lines))
    return path


@contextmanager
def context_with(path):
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', str(path)])
    try:
        yield context
    finally:
        rclpy.shutdown(context=context)


def values_by_rcl(context, namespace):
    node = Node(
        PLANT,
        namespace=namespace or None,
        context=context,
        automatically_declare_parameters_from_overrides=True,
        enable_rosout=False,
    )
    try:
        own = node.get_parameters_by_prefix('mine')
        return {f'mine.{name}': parameter.value for name, parameter in own.items()}
    finally:
        node.destroy_node()


@settings(max_examples=12, deadline=None)
@given(st.lists(st.sampled_from(KEYS), min_size=1, unique=True))
def test_a_node_gets_what_rcl_gives_it(tmp_path_factory, keys):
    path = tmp_path_factory.mktemp('files') / 'file.yaml'
    write(path, [(key, {f'mine.only_{i}': i, 'mine.all': i}) for i, key in enumerate(keys)])

    with context_with(path) as context:
        for namespace in NAMESPACES:
            expected = values_by_rcl(context, namespace)
            assert read_parameter_file(path).values_of(f'{namespace}/{PLANT}') == expected


@pytest.mark.parametrize(
    ('text', 'keys'),
    [
        ('left:\n  plant_sim:\n    ros__parameters: {seed: 1}\n', ['left/plant_sim']),
        (
            '/cell:\n  left:\n    plant_sim: {ros__parameters: {seed: 1}}\n'
            '    event_camera: {ros__parameters: {seed: 2}}\n',
            ['/cell/left/plant_sim', '/cell/left/event_camera'],
        ),
        ('/:\n  plant_sim: {ros__parameters: {seed: 1}}\n', ['/plant_sim']),
    ],
)
def test_namespaces_may_be_nested(text, keys, tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_text(text)

    assert [section.key for section in read_parameter_file(path).sections] == keys


@pytest.mark.parametrize('key', ['/plant_sim.', '/plant+sim', '/(plant_sim)'])
def test_a_key_is_no_regular_expression(key):
    assert not Section(key=key, values={}).matches('/plant_sim')


# -- the values of a loop -------------------------------------------------------------------------


def test_each_node_has_its_own_values_and_the_tools_know_whose_count(tmp_path):
    path = write(
        tmp_path / 'file.yaml',
        [
            ('/**', {'event_threshold': 0.2, 'seed': 1}),
            (CONTROLLER, {'event_threshold': 0.1, 'initial_state': '[0.1, 0.2]'}),
            (PLANT, {'seed': 2}),
        ],
    )

    scenario = load_scenario(path)
    controller = load_scenario(path, node=CONTROLLER)

    assert scenario.sensor.event_threshold == 0.2
    assert scenario.plant.initial_state == (0.4821, 0.1572)
    assert scenario.loop.seed == 2
    assert controller.sensor.event_threshold == 0.1
    assert controller.plant.initial_state == (0.1, 0.2)
    assert load_scenario(path, node=CAMERA).loop.seed == 1
    with pytest.raises(ParameterError, match=r'event_threshold = 0\.2 for event_camera, 0\.1 for'):
        read_loop_values(path).require_alike()


@pytest.mark.parametrize(
    ('key', 'namespace'),
    [
        ('plant_sim', ''),
        ('/left/plant_sim', '/left'),
        ('/**/plant_sim', '/anywhere/at/all'),
        ('/*/plant_sim', '/left'),
        ('/left/**', '/left'),
    ],
)
def test_a_key_that_matches_is_taken_with_a_namespace_and_without_one(key, namespace, tmp_path):
    path = write(tmp_path / 'file.yaml', [(key, {'duration': 0.3})])

    assert load_scenario(path, namespace=namespace).loop.duration == 0.3
    assert load_scenario(path).loop.duration == 0.3


@pytest.mark.parametrize(
    ('sections', 'namespace', 'reason'),
    [
        ([('plant_sim', {'seed': 1})], '/left', 'plant_sim, which is no node of this loop: they '),
        ([('/right/**', {'seed': 1})], '/left', '/right/\\*\\*, which is no node of this loop'),
        ([('/left/plant_sim', {'seed': 1})], '', 'they are /plant_sim, /event_camera, /hinf'),
        ([('/**', {'seed': 1}), ('plnat_sim', {'seed': 2})], None, 'plnat_sim, which is no node'),
        (
            [('/left/plant_sim', {'seed': 1}), ('/right/plant_sim', {'seed': 1})],
            None,
            'has values for /left/plant_sim, which is no node',
        ),
        ([(CAMERA, {'set_point': '[0.0, 0.0]'})], None, 'given to event_camera, which does not'),
        ([(CONTROLLER, {'plant.mass': 1.0})], None, 'does not read it: plant_sim would'),
        ([(CONTROLLER, {'event_threshold': -1.0})], None, 'event_threshold = -1.0: must be'),
        ([(CAMERA, {'event_treshold': 1.0})], None, 'did you mean event_threshold'),
    ],
)
def test_what_no_node_would_get_is_refused_by_name(sections, namespace, reason, tmp_path):
    path = write(tmp_path / 'file.yaml', sections)

    with pytest.raises(ParameterError, match=reason):
        load_scenario(path, namespace=namespace)


def test_a_parameter_that_only_tools_read_may_stand_under_any_node(tmp_path):
    path = write(tmp_path / 'file.yaml', [(CAMERA, {'plant_executable': 'pkg/exe'})])

    assert load_scenario(path).plant.plant_executable == 'pkg/exe'
