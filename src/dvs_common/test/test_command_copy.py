"""Commands in the messages of others: rclpy reads them, and what does not fit is refused."""

import numpy as np
import pytest
from geometry_msgs.msg import Twist, Wrench
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray

from dvs_common.errors import ParameterError
from dvs_common.wire.command_copy import command_copy


def test_an_array_carries_the_inputs_in_order():
    copy = command_copy('array', 3)
    message = deserialize_message(copy.pack(np.array([1.0, -2.0, 0.5])), Float64MultiArray)

    assert copy.topic == 'commands'
    assert list(message.data) == [1.0, -2.0, 0.5]


def test_a_twist_carries_each_input_in_its_field():
    copy = command_copy('angular.z, linear.x', 2)
    message = deserialize_message(copy.pack(np.array([3.0, 4.0])), Twist)

    assert copy.topic == 'cmd_vel'
    assert (message.angular.z, message.linear.x) == (3.0, 4.0)
    assert (message.linear.y, message.linear.z, message.angular.x) == (0.0, 0.0, 0.0)


def test_a_wrench_carries_each_input_in_its_field():
    copy = command_copy('force.y', 1)
    message = deserialize_message(copy.pack(np.array([7.0])), Wrench)

    assert copy.topic == 'wrench'
    assert message.force.y == 7.0
    assert message.torque.x == 0.0


def test_no_copy_is_the_default():
    assert command_copy('', 2) is None


@pytest.mark.parametrize(
    ('text', 'rule'),
    [
        ('linear', 'fields out of linear.x'),
        ('linear.x', '2 different'),
        ('linear.x, linear.x', '2 different'),
        ('linear.x, torque.z', 'one message'),
    ],
)
def test_fields_that_do_not_fit_are_refused(text, rule):
    with pytest.raises(ParameterError, match=rule):
        command_copy(text, 2)
