"""The schema's parameters as rclpy takes them: types, descriptors, plain values."""

from __future__ import annotations

import array
import math
import sys
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from dvs_common.scenario.schema import Kind, ParameterSpec

ROS_TYPE = {
    Kind.BOOL: Parameter.Type.BOOL,
    Kind.INT: Parameter.Type.INTEGER,
    Kind.FLOAT: Parameter.Type.DOUBLE,
    Kind.TEXT: Parameter.Type.STRING,
    Kind.INTS: Parameter.Type.INTEGER_ARRAY,
    Kind.FLOATS: Parameter.Type.DOUBLE_ARRAY,
}


def plain(value: Any) -> Any:
    """Value as the schema has it: rclpy hands out lists as arrays, and empty ones as None.

    Parameters
    ----------
    value
        Value of a ROS parameter.
    """
    if value is None:
        return []
    return list(value) if isinstance(value, array.array) else value


def descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Descriptor of a parameter.

    Parameters
    ----------
    spec
        Its entry in the schema.
    """
    unit = f' [{spec.unit}]' if spec.unit else ''
    descriptor = ParameterDescriptor(
        name=spec.name,
        type=ROS_TYPE[spec.kind].value,
        description=spec.description + unit,
        additional_constraints=spec.rule,
        read_only=spec.read_only,
    )
    low, high = spec.interval.low, spec.interval.high
    if spec.kind is Kind.FLOAT and (math.isfinite(low) or math.isfinite(high)):
        largest = sys.float_info.max
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=max(low, -largest), to_value=min(high, largest))
        ]
    if spec.kind is Kind.INT and (math.isfinite(low) or math.isfinite(high)):
        descriptor.integer_range = [
            IntegerRange(
                from_value=int(max(low, -(2.0**62))), to_value=int(min(high, 2.0**63 - 1024))
            )
        ]
    return descriptor
