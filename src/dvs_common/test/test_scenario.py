"""Parameter files and what becomes of them: the types that every node works with."""

import pickle
import re
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.fields import specs_of
from dvs_common.scenario.parameters import GROUPS, SCHEMA
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.scenario.sensor_parameters import SensorParameters

ROOT = Path(__file__).resolve().parents[3]
FILES = sorted((ROOT / 'config').glob('*.yaml'))


def scenario(**values):
    return Scenario.from_values(values)


def load(tmp_path, text):
    path = tmp_path / 'scenario.yaml'
    path.write_text(text)
    return load_scenario(path)


def parameters(*lines):
    return '/**:\n  ros__parameters:\n' + ''.join(f'    {line}\n' for line in lines)


# -- files ----------------------------------------------------------------------------------------


def test_the_defaults_are_the_scenario_mirror_r3():
    assert load_scenario(ROOT / 'config' / 'mirror_r3.yaml').values == scenario().values


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_every_scenario_in_config_is_sound(path):
    loaded = load_scenario(path)

    loaded.model.require_stabilizable()
    loaded.model.require_detectable()
    n, m = loaded.model.state_count, loaded.model.input_count
    assert loaded.equilibrium.state.shape == loaded.initial_state.shape == (n,)
    assert loaded.command_limit.shape == (m,)
    assert loaded.model_reference_bounds.lower.shape == (loaded.scene.pixel_count,)
    assert loaded.sampling_period_ns > 0


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('{', 'is not YAML'),
        (parameters('tolerance: 0.05', 'tolerance: 0.1'), 'tolerance is given twice'),
        ('a: \x00', 'is not YAML'),
        (parameters('duration: 2001-99-99'), 'is not YAML'),
        ('', 'must be a mapping'),
        ('- 1', 'must be a mapping'),
        ('event_threshold: 0.1', 'has no ros__parameters under event_threshold'),
        ('/**:\n  event_threshold: 0.1', r'has no ros__parameters under /\*\*'),
        ('/**:\n  ros__parameters: 3', r'has no ros__parameters under /\*\*'),
        (parameters('event_treshold: 0.1'), 'did you mean event_threshold'),
        (parameters('3: 0.1'), '3 = 0.1: is not a parameter'),
        (parameters('event_threshold: -0.1'), 'event_threshold = -0.1: must be'),
        (parameters('event_threshold: .nan'), 'event_threshold = nan: must be'),
        (parameters('event_threshold: 0.1 s'), "event_threshold = '0.1 s': must be"),
    ],
)
def test_a_file_that_is_not_sound_is_refused(text, reason, tmp_path):
    with pytest.raises(ParameterError, match=reason):
        load(tmp_path, text)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='cannot be read: No such file'):
        load_scenario(tmp_path / 'none.yaml')
    with pytest.raises(ParameterError, match='cannot be read: Is a directory'):
        load_scenario(tmp_path)
    (tmp_path / 'latin.yaml').write_bytes(b'a: \xff')
    with pytest.raises(ParameterError, match='is not YAML'):
        load_scenario(tmp_path / 'latin.yaml')


@pytest.mark.parametrize(
    ('text', 'value'), [('1e-3', 1e-3), ('2E+1', 20.0), ('-1e0', -1.0), ('1.5e-3', 1.5e-3)]
)
def test_a_number_without_a_point_is_read_as_ros_reads_it(text, value, tmp_path):
    # YAML 1.1 takes 1e-3 for a string; ROS takes it for a double.
    loaded = load(tmp_path, parameters(f'set_point: [{text}, 0.0]'))

    assert loaded['set_point'] == (value, 0.0)


def test_the_parameters_of_several_nodes_are_merged(tmp_path):
    text = parameters('event_threshold: 0.2') + 'plant_sim:\n  ros__parameters:\n    seed: 4\n'

    loaded = load(tmp_path, text)

    assert (loaded['event_threshold'], loaded['seed']) == (0.2, 4)


def test_what_ros_itself_puts_into_a_file_is_passed_over(tmp_path):
    loaded = load(tmp_path, parameters('use_sim_time: true', 'seed: 4'))

    assert loaded['seed'] == 4
    assert 'use_sim_time' not in loaded.values


def test_every_parameter_is_used_somewhere():
    code = '\n'.join(
        path.read_text()
        for path in ROOT.glob('src/*/dvs_*/**/*.py')
        if not path.name.endswith('parameters.py')
    )
    unused = [name for name in SCHEMA if not re.search(rf'\b{name}\b', code)]
    assert not unused


# -- what becomes of the values -------------------------------------------------------------------


def test_replace_changes_and_checks():
    changed = scenario(seed=3).replace(event_threshold=0.2)

    assert (changed['seed'], changed['event_threshold']) == (3, 0.2)
    with pytest.raises(ParameterError, match='event_threshold = 0'):
        changed.replace(event_threshold=0)


def test_a_parameter_is_an_attribute_of_its_group_and_has_a_flat_name():
    changed = scenario(event_threshold=0.2, mode='realtime', latency=1)

    assert changed.sensor.event_threshold == changed['event_threshold'] == 0.2
    assert changed.loop.mode == changed['mode'] == 'realtime'
    assert changed.imperfections.latency == changed['latency'] == 1.0
    assert {name: changed[name] for name in changed.values} == changed.values
    assert list(changed.values) == list(SCHEMA)
    with pytest.raises(KeyError):
        changed['no_parameter']


def test_every_parameter_belongs_to_one_group_and_every_group_to_a_scenario():
    names = [spec.name for group in GROUPS.values() for spec in specs_of(group)]

    assert names == list(SCHEMA)
    assert {name: type(getattr(scenario(), name)) for name in GROUPS} == GROUPS


def test_a_group_checks_what_it_is_built_of():
    assert SensorParameters(event_threshold=1).event_threshold == 1.0
    with pytest.raises(ParameterError, match='event_threshold = -1: must be a finite double > 0'):
        SensorParameters(event_threshold=-1)
    with pytest.raises(FrozenInstanceError):
        scenario().sensor.event_threshold = 0.3


def test_what_belongs_to_another_plant_comes_along_by_its_whole_name():
    changed = scenario(**{'plant.mass': 1.5, 'plant.sides': [1, 2]}).replace(seed=3)

    assert changed.plant_extras == {'plant.mass': 1.5, 'plant.sides': (1, 2)}
    assert changed['plant.mass'] == 1.5
    with pytest.raises(ParameterError, match=r'mass = 1\.5: must begin with plant'):
        Scenario(plant_extras={'mass': 1.5})


def test_a_scenario_can_be_sent_to_another_process():
    sent = scenario(event_threshold=0.2, **{'plant.mass': 1.5})

    assert pickle.loads(pickle.dumps(sent)) == sent


def test_values_cannot_be_changed():
    with pytest.raises(TypeError):
        scenario().values['seed'] = 3


@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_flat_lists_become_matrices_row_by_row(n, m, seed):
    generator = np.random.default_rng(seed)
    a, b = generator.standard_normal((n, n)), generator.standard_normal((n, m))
    c = generator.standard_normal(n)

    model = scenario(state_matrix=a.ravel(), input_matrix=b.ravel(), output_vector=c).model

    np.testing.assert_array_equal(model.state_matrix, a)
    np.testing.assert_array_equal(model.input_matrix, b)
    np.testing.assert_array_equal(model.output_vector, c)


GRID = {'pixel_grid': (2, 3), 'pixel_pitch': (0.1, 0.0, 0.0, 1.0), 'output_vector': (1.0, 2.0)}


def test_a_regular_grid_is_centred_and_row_major():
    np.testing.assert_allclose(
        scenario(**GRID).scene.brightness_offsets, [-1.1, -1.0, -0.9, 0.9, 1.0, 1.1]
    )
    np.testing.assert_allclose(
        scenario(**GRID, pixel_origin=(0.5, 1.0)).scene.brightness_offsets,
        [1.4, 1.5, 1.6, 3.4, 3.5, 3.6],
    )


def test_a_regular_grid_is_the_same_as_its_offsets():
    offsets = [
        [(column - 1) * 0.1 + 0.5, (row - 0.5) * 1.0 + 1.0]
        for row in range(2)
        for column in range(3)
    ]
    listed = scenario(pixel_grid=(2, 3), pixel_offsets=np.ravel(offsets), output_vector=(1.0, 2.0))
    regular = scenario(**GRID, pixel_origin=(0.5, 1.0))

    np.testing.assert_allclose(
        listed.scene.brightness_offsets, regular.scene.brightness_offsets, atol=1e-15
    )


@pytest.mark.parametrize(
    ('values', 'part', 'name'),
    [
        ({'output_vector': ()}, 'model', 'output_vector'),
        ({'output_vector': ()}, 'scene', 'output_vector'),
        ({'output_vector': (0.0, 0.0)}, 'model', 'output_vector'),
        ({'output_vector': (1.0, 0.0, 0.0)}, 'model', 'state_matrix'),
        ({'state_matrix': (1.0, 2.0)}, 'model', 'state_matrix'),
        ({'input_matrix': ()}, 'model', 'input_matrix'),
        ({'input_matrix': (1.0, 2.0, 3.0)}, 'model', 'input_matrix'),
        ({'pixel_offsets': ()}, 'scene', 'pixel_offsets'),
        ({'pixel_offsets': (1.0, 2.0, 3.0)}, 'scene', 'pixel_offsets'),
        ({'pixel_offsets': (0.0, 0.0)}, 'scene', 'pixel_grid'),
        ({'pixel_grid': (3,)}, 'scene', 'pixel_grid'),
        ({'pixel_grid': (1, 3, 1)}, 'scene', 'pixel_grid'),
        ({'pixel_pitch': (1.0, 0.0)}, 'scene', 'pixel_pitch'),
        ({'pixel_origin': (1.0, 0.0)}, 'scene', 'pixel_origin'),
        ({**GRID, 'pixel_origin': (1.0,)}, 'scene', 'pixel_origin'),
        ({'initial_state': (1.0,)}, 'initial_state', 'initial_state'),
        ({'set_point': (1.0,)}, 'equilibrium', 'set_point'),
        ({'set_point': (1.0, 1.0)}, 'equilibrium', 'set_point'),
        ({'command_limit': (1.0, 2.0)}, 'command_limit', 'command_limit'),
        ({'reference_lower': (0.1,)}, 'model_reference_bounds', 'reference_upper'),
        ({'reference_upper': (0.1,)}, 'model_reference_bounds', 'reference_lower'),
        (
            {'reference_lower': (0.1, 0.1), 'reference_upper': (0.2,)},
            'model_reference_bounds',
            'reference_lower',
        ),
    ],
)
def test_values_that_do_not_fit_together_are_refused_by_name(values, part, name):
    with pytest.raises(ParameterError) as caught:
        getattr(scenario(**values), part)
    assert caught.value.name == name


def test_reference_bounds_are_spread_over_the_pixels():
    bounds = scenario(reference_lower=[0.4], reference_upper=[0.5, 0.6, 0.7])
    bounds = bounds.reference_bounds(np.ones(3))

    np.testing.assert_array_equal(bounds.lower, [0.4] * 3)
    np.testing.assert_array_equal(bounds.upper, [0.5, 0.6, 0.7])


def test_without_bounds_they_come_from_the_first_luminosity():
    start = scenario(reference_uncertainty=0.002)
    first = start.scene.luminosity(start.model, start.initial_state)

    bounds = start.model_reference_bounds

    np.testing.assert_allclose(bounds.lower, first - 0.002)
    np.testing.assert_allclose(bounds.upper, first + 0.002)


def test_command_limits_are_spread_over_the_inputs():
    two = {'input_matrix': (1.0, 0.0, 0.0, 1.0)}

    assert scenario(**two).command_limit.tolist() == [np.inf, np.inf]
    assert scenario(**two, command_limit=[3]).command_limit.tolist() == [3, 3]
    assert scenario(**two, command_limit=[3, 4]).command_limit.tolist() == [3, 4]


@pytest.mark.parametrize(
    ('period', 'duration', 'period_ns', 'samples'),
    [
        (1e-3, 6.0, 1_000_000, 6000),
        (1 / 3, 1.0, 333_333_333, 3),
        (1e-6, 1e-3, 1000, 1000),
        (1e-3, 0.0, 1_000_000, 0),
        (1e-3, 1e-5, 1_000_000, 1),
    ],
)
def test_times_are_counted_in_nanoseconds_and_samples(period, duration, period_ns, samples):
    timed = scenario(sampling_period=period, duration=duration)

    assert timed.sampling_period_ns == period_ns
    assert timed.sample_count == samples


# -- several pixel groups ------------------------------------------------------------------

STRIPES = {
    'state_matrix': [0.0, 1.0, 0.0, 0.0],
    'input_matrix': [0.0, 1.0],
    'output_vector': [1.0, 0.0, 0.5, 2.0],
    'initial_state': [0.1, 0.2],
    'pixel_grid': [2, 2],
    'pixel_groups': [0, 1],
    'pixel_offsets': [1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 2.0, 0.0],
}


def test_every_row_of_the_array_sees_its_own_group():
    striped = scenario(**STRIPES)
    y = striped.scene.luminosity(striped.model, striped.initial_state)
    c = np.array(STRIPES['output_vector']).reshape(2, 2)
    seen = np.array(STRIPES['pixel_offsets']).reshape(4, 2) + striped.initial_state
    assert y == pytest.approx([c[0] @ seen[0], c[0] @ seen[1], c[1] @ seen[2], c[1] @ seen[3]])
    assert np.array_equal(striped.scene.groups, [0, 0, 1, 1])
    each = scenario(**{**STRIPES, 'pixel_groups': [0, 0, 1, 1]})
    assert np.array_equal(each.scene.brightness_offsets, striped.scene.brightness_offsets)


def test_a_regular_grid_of_two_groups_is_the_same_as_its_offsets():
    pitch = np.array([[0.1, 0.2], [0.3, 0.4]])
    grid = scenario(**{**STRIPES, 'pixel_offsets': [], 'pixel_pitch': pitch.ravel().tolist()})
    offsets = [row * pitch[1] + column * pitch[0] for row in (-0.5, 0.5) for column in (-0.5, 0.5)]
    same = scenario(**{**STRIPES, 'pixel_offsets': np.ravel(offsets).tolist()})
    assert grid.scene.brightness_offsets == pytest.approx(same.scene.brightness_offsets)
    assert np.array_equal(grid.scene.groups, same.scene.groups)


def test_groups_that_are_all_the_first_are_one_group():
    plain, named = scenario(), scenario(pixel_groups=[0])
    assert named.scene.groups is None
    assert np.array_equal(named.model.output_vector, plain.model.output_vector)
    assert np.array_equal(named.scene.brightness_offsets, plain.scene.brightness_offsets)


@pytest.mark.parametrize(
    ('values', 'part', 'reason'),
    [
        ({'pixel_groups': [0, 2]}, 'model', r'^pixel_groups = .* every group from 0 to 2'),
        ({'pixel_groups': [0, 1, 0]}, 'scene', r'^pixel_groups = .* must have 2 entries'),
        ({'output_vector': [1.0, 0.0, 0.5]}, 'model', r'^output_vector = .* must have 2 rows'),
        ({'output_vector': [1.0, 0.0, 0.0, 0.0]}, 'model', '^output_vector = .* not be zero'),
    ],
)
def test_groups_that_do_not_fit_are_refused_by_name(values, part, reason):
    with pytest.raises(ParameterError, match=reason):
        getattr(scenario(**{**STRIPES, **values}), part)


def test_what_takes_one_group_names_the_parameter_and_the_number():
    with pytest.raises(ParameterError, match=r'^output_vector = .* has 2 pixel groups'):
        _ = scenario(**STRIPES).model.gradient
