"""Commands that a plant takes: m finite numbers, matched by name."""

import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import Vector, pack_command
from dvs_plant_sim.plant_sim_node import PlantSimNode


@pytest.fixture(scope='module')
def plant():
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    two_inputs = [Parameter('input_matrix', value=[1.0, 0.0, 0.0, 1.0])]
    node = PlantSimNode(context=context, parameter_overrides=two_inputs)
    node.configure(node.scenario())
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def command(names, values):
    return pack_command(Vector(stamp_ns=0, names=names, values=np.array(values)))


def test_entries_are_matched_by_name_and_not_by_position(plant):
    taken = plant.checked_command(command(('u2', 'u1'), [5.0, 0.0]))

    assert taken.values.tolist() == [0.0, 5.0]


@pytest.mark.parametrize(
    ('names', 'values', 'reason'),
    [
        (('left', 'right'), [1.0, 2.0], 'has the names left, right, must have u1, u2'),
        (('u1', 'u1'), [1.0, 2.0], 'has the names u1, u1, must have u1, u2'),
        (('u0', 'u1'), [1.0, 2.0], 'has the names u0, u1'),
        (('u1',), [1.0], 'is not 2 finite numbers'),
        (('u1', 'u2'), [1.0, np.inf], 'is not 2 finite numbers'),
    ],
)
def test_what_does_not_name_the_inputs_is_refused(plant, names, values, reason):
    with pytest.raises(MessageError, match=reason):
        plant.checked_command(command(names, values))
