"""A parameter is declared once, on its field: `parameter` gives the field its entry of the schema.

A group of parameters is a frozen dataclass whose fields are made by `parameter`. The field's name
is the name of the ROS parameter and its annotation the type.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from dvs_common.scenario.schema import ANY, Interval, Kind, ParameterSpec, Value

_KINDS = {
    'bool': Kind.BOOL,
    'int': Kind.INT,
    'float': Kind.FLOAT,
    'str': Kind.TEXT,
    'tuple[int, ...]': Kind.INTS,
    'tuple[float, ...]': Kind.FLOATS,
}


def parameter(
    default: Value,
    description: str,
    *,
    nodes: Collection[str] = (),
    unit: str = '',
    interval: Interval = ANY,
    choices: tuple[str, ...] = (),
    dynamic: bool = False,
    read_only: bool = False,
) -> Any:
    """Field of a `ParameterGroup`; see `ParameterSpec`."""
    rules = {
        'default': default,
        'description': description,
        'nodes': frozenset(nodes),
        'unit': unit,
        'interval': interval,
        'choices': choices,
        'dynamic': dynamic,
        'read_only': read_only,
    }
    return dataclasses.field(default=default, metadata=rules)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterGroup:
    """Parameters that belong together, each checked by its own rule.

    Raises
    ------
    ParameterError
        If a value has the wrong type or breaks its parameter's rule.
    """

    def __post_init__(self) -> None:
        """Check every value; integers become doubles and sequences tuples where they have to."""
        for spec in specs_of(type(self)):
            object.__setattr__(self, spec.name, spec.validate(getattr(self, spec.name)))


def specs_of(group: type[ParameterGroup]) -> tuple[ParameterSpec, ...]:
    """Entries of the schema that the fields of a group declare.

    Parameters
    ----------
    group
        A dataclass whose fields are made by `parameter`.
    """
    return tuple(
        ParameterSpec(name=field.name, kind=_KINDS[str(field.type)], **field.metadata)
        for field in dataclasses.fields(group)
    )
