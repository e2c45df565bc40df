"""What a parameter is: its type, range, unit and meaning, and how a value of it is checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import Enum
from numbers import Real
from typing import Any

from dvs_common.errors import ParameterError

# Names that ROS itself puts into parameter files and overrides.
_ROS_NAMES = ('use_sim_time', 'start_type_description_service', 'qos_overrides')

Value = bool | int | float | str | tuple[int, ...] | tuple[float, ...]


def is_ros_parameter(name: str) -> bool:
    """Whether a parameter belongs to ROS and not to this suite.

    Parameters
    ----------
    name
        Name of the parameter, groups divided by dots.
    """
    return name.split('.')[0] in _ROS_NAMES


class Kind(Enum):
    """Type of a parameter's value."""

    BOOL = 'bool'
    INT = 'integer'
    FLOAT = 'double'
    TEXT = 'string'
    INTS = 'integer array'
    FLOATS = 'double array'

    @property
    def is_array(self) -> bool:
        """Whether a value is a sequence of numbers."""
        return self in (Kind.INTS, Kind.FLOATS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Numbers that a parameter, or each entry of an array parameter, may take.

    Parameters
    ----------
    low
        Lower end.
    high
        Upper end.
    low_open
        Whether the lower end itself is excluded.
    """

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False

    def __contains__(self, number: float) -> bool:
        """Whether `number` is inside; NaN never is."""
        above = number > self.low if self.low_open else number >= self.low
        return above and number <= self.high

    def __str__(self) -> str:
        """Return the rule in words, empty if every number is allowed."""
        parts = []
        if self.low > -math.inf:
            parts.append(f'{">" if self.low_open else ">="} {self.low:g}')
        if self.high < math.inf:
            parts.append(f'<= {self.high:g}')
        return ' and '.join(parts)


ANY = Interval()
POSITIVE = Interval(low=0, low_open=True)
NON_NEGATIVE = Interval(low=0)
SHARE = Interval(low=0, high=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSpec:
    """One parameter of the suite.

    Parameters
    ----------
    name
        Name in parameter files and on the command line.
    kind
        Type of its value.
    default
        Value without a parameter file.
    description
        What it means, in one sentence, with the paper's symbol.
    nodes
        Executables that read it.
    unit
        Unit, empty for a pure number.
    interval
        Allowed numbers.
    choices
        Allowed words of a text parameter; empty for free text.
    dynamic
        Whether it may change while the node is active.
    read_only
        Whether it can't change once the node has started.
    """

    name: str
    kind: Kind
    default: Value
    description: str
    nodes: frozenset[str] = field(default_factory=frozenset)
    unit: str = ''
    interval: Interval = ANY
    choices: tuple[str, ...] = ()
    dynamic: bool = False
    read_only: bool = False

    @property
    def rule(self) -> str:
        """What a value must be, in words."""
        if self.choices:
            return f'must be one of {", ".join(self.choices)}'
        kind = self.kind.value
        if self.kind.is_array:
            kind = kind.replace('array', 'list') + ' without NaN or infinity'
        elif self.kind is Kind.FLOAT:
            kind = 'finite double'
        article = 'an' if kind[0] in 'aeiou' else 'a'
        interval = str(self.interval)
        return f'must be {article} {kind}' + (f' {interval}' if interval else '')

    def validate(self, value: Any) -> Value:
        """Checked value: integers pass for doubles, sequences become tuples.

        Parameters
        ----------
        value
            Value from a file, a command line or another program.

        Raises
        ------
        ParameterError
            If the value has the wrong type or breaks the parameter's rule.
        """
        if self.kind.is_array:
            return self._validate_array(value)
        if self.kind is Kind.TEXT:
            if not isinstance(value, str) or (self.choices and value not in self.choices):
                raise ParameterError(self.name, value, self.rule)
            return value
        if self.kind is Kind.BOOL:
            if not isinstance(value, bool):
                raise ParameterError(self.name, value, self.rule)
            return value
        number: int | float = self._validate_number(value, whole=self.kind is Kind.INT)
        return number

    def _validate_array(self, value: Any) -> Value:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            raise ParameterError(self.name, value, self.rule)
        whole = self.kind is Kind.INTS
        return tuple(self._validate_number(entry, whole=whole) for entry in value)

    def _validate_number(self, value: Any, *, whole: bool) -> Any:
        if not _is_finite(value) or value not in self.interval:
            # In quotes, since what is written as text looks like the number that it is not.
            shown = repr(value) if isinstance(value, str) else value
            raise ParameterError(self.name, shown, self.rule)
        if whole and value != int(value):
            raise ParameterError(self.name, value, self.rule)
        return int(value) if whole else float(value)


def _is_finite(value: Any) -> bool:
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


class Schema(Mapping[str, ParameterSpec]):
    """All parameters by name.

    Parameters
    ----------
    specs
        Parameters; names must differ.
    open_groups
        Prefixes of names that another node declares and checks.
    """

    def __init__(self, specs: Iterable[ParameterSpec], open_groups: tuple[str, ...] = ()) -> None:
        self._specs: dict[str, ParameterSpec] = {}
        self._open_groups = open_groups
        for spec in specs:
            if spec.name in self._specs:
                raise ValueError(f'parameter {spec.name} is listed twice')
            self._specs[spec.name] = spec

    def __getitem__(self, name: str) -> ParameterSpec:
        """Return the parameter called `name`."""
        return self._specs[name]

    def __iter__(self) -> Any:
        """Iterate over the names in the order of the table."""
        return iter(self._specs)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self._specs)

    def of_node(self, node: str) -> list[ParameterSpec]:
        """Parameters that the executable `node` reads.

        Parameters
        ----------
        node
            Name of the executable.
        """
        return [spec for spec in self._specs.values() if node in spec.nodes]

    def closed(self, specs: Iterable[ParameterSpec]) -> Schema:
        """Schema of the owner of the open groups: these parameters too, and no others.

        Parameters
        ----------
        specs
            Further parameters.
        """
        return Schema((*self._specs.values(), *specs))

    def validate(self, values: Mapping[str, Any]) -> dict[str, Value]:
        """Checked values of all parameters, defaults where `values` has none.

        Values of an open group come along as they are.

        Parameters
        ----------
        values
            Values by name.

        Raises
        ------
        ParameterError
            If a name is unknown (with the nearest known one) or a value breaks its rule.
        """
        self.require_known(values)
        known = {
            name: spec.validate(values[name]) if name in values else spec.default
            for name, spec in self._specs.items()
        }
        foreign = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
            if name not in self._specs
        }
        return {**known, **foreign}

    def require_known(self, values: Mapping[str, Any]) -> None:
        """Raise `ParameterError` for a name that is neither known nor of an open group.

        Parameters
        ----------
        values
            Values by name.
        """
        for name, value in values.items():
            if name not in self._specs and not name.startswith(self._open_groups):
                near = get_close_matches(name, self._specs, n=1)
                hint = f'; did you mean {near[0]}?' if near else ''
                raise ParameterError(name, value, f'is not a parameter of this suite{hint}')
