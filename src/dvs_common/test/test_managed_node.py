"""The parameters of a real node: described, and read from a file as `load_scenario` reads them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from dvs_common.errors import ParameterError
from dvs_common.node.managed_node import ManagedNode
from dvs_common.scenario.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.scenario.schema import Kind

FILES = sorted((Path(__file__).resolve().parents[3] / 'config').glob('*.yaml'))
TYPES = {
    Kind.BOOL: ParameterType.PARAMETER_BOOL,
    Kind.INT: ParameterType.PARAMETER_INTEGER,
    Kind.FLOAT: ParameterType.PARAMETER_DOUBLE,
    Kind.TEXT: ParameterType.PARAMETER_STRING,
    Kind.INTS: ParameterType.PARAMETER_INTEGER_ARRAY,
    Kind.FLOATS: ParameterType.PARAMETER_DOUBLE_ARRAY,
}


@contextmanager
def node(executable: str, *arguments: str) -> Iterator[ManagedNode]:
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', *arguments])
    try:
        made = ManagedNode(executable, context=context)
        yield made
        made.destroy_node()
    finally:
        rclpy.shutdown(context=context)


@pytest.mark.parametrize('executable', [PLANT, CAMERA, CONTROLLER])
def test_every_parameter_is_declared_with_type_range_and_meaning(executable):
    with node(executable) as made:
        for spec in SCHEMA.of_node(executable):
            found = made.describe_parameter(spec.name)
            assert found.type == TYPES[spec.kind]
            assert spec.description in found.description
            assert spec.unit in found.description
            assert found.additional_constraints == spec.rule
            for limits in (*found.floating_point_range, *found.integer_range):
                assert (limits.from_value in spec.interval) or spec.interval.low_open
                assert limits.to_value in spec.interval
            default = made.get_parameter_or(spec.name).value
            assert (tuple(default or ()) if spec.kind.is_array else default) == spec.default


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_a_node_reads_a_file_as_the_tools_do(path, monkeypatch):
    # A node takes a relative path from where it was started; tools hand on what is in the file.
    monkeypatch.chdir(path.parent)
    with node(CONTROLLER, '--params-file', str(path)) as made:
        mine, other = made.scenario(), load_scenario(path)
    knots = {'brightness_profile': other['brightness_profile']}
    assert {**mine.values, **knots} == other.values
    state = other.equilibrium.state
    assert np.array_equal(
        mine.scene.luminosity(mine.model, state), other.scene.luminosity(other.model, state)
    )


def test_without_a_file_a_node_has_the_defaults():
    with node(CAMERA) as made:
        assert made.scenario().values == Scenario.from_values({}).values


def test_numbers_mean_the_same_in_a_file_and_on_the_command_line(tmp_path):
    path = tmp_path / 'numbers.yaml'
    lines = ['duration: 3', 'sampling_period: 2e-3', 'tolerance: 1.0E-1', 'use_sim_time: false']
    path.write_text('/**:\n  ros__parameters:\n' + ''.join(f'    {line}\n' for line in lines))

    with node(PLANT, '--params-file', str(path)) as made:
        assert made.scenario().values == load_scenario(path).values
        assert made.scenario()['sampling_period'] == 2e-3
    with node(PLANT, '-p', 'duration:=3', '-p', 'plant_sim:sampling_period:=2e-3') as made:
        assert (made.scenario()['duration'], made.scenario()['sampling_period']) == (3.0, 2e-3)


def test_an_unknown_name_is_refused():
    with (
        pytest.raises(ParameterError, match='did you mean log_base'),
        node(CAMERA, '-p', 'log_bas:=2.0'),
    ):
        pass


def test_a_value_that_breaks_its_rule_cannot_be_set():
    with node(CAMERA) as made:
        change = Parameter('interpolation', Parameter.Type.STRING, 'cubic')
        result = made.set_parameters([change])[0]

        assert not result.successful
        assert 'must be one of linear_log, hermite' in result.reason
        assert made.scenario()['interpolation'] == 'linear_log'


def test_an_active_node_keeps_what_is_not_dynamic():
    with node(PLANT) as made:
        made.is_active = True
        fixed = made.set_parameters([Parameter('duration', Parameter.Type.DOUBLE, 1.0)])[0]
        moving = made.set_parameters([Parameter('real_time_factor', Parameter.Type.DOUBLE, 1.0)])[
            0
        ]

        assert not fixed.successful
        assert 'can only change while the node is not active' in fixed.reason
        assert moving.successful
        assert made.scenario()['real_time_factor'] == 1.0
