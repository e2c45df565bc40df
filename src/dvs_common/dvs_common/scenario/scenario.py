"""A scenario: one validated set of parameters that serves every node and tool."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import Equilibrium, FloatArray, PixelScene, PlantModel
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.schema import Value, is_ros_parameter

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Scenario:
    """Validated parameters, and the model types that they describe.

    Parameters
    ----------
    values
        Value of every parameter of the schema.

    See Also
    --------
    load_scenario : from a parameter file.
    """

    values: Mapping[str, Value]

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Scenario:
        """Scenario with `values` and the schema's defaults for the rest.

        Parameters
        ----------
        values
            Values by parameter name.

        Raises
        ------
        ParameterError
            If a name is unknown or a value breaks its rule.
        """
        return cls(MappingProxyType(SCHEMA.validate(values)))

    def replace(self, **changes: Any) -> Scenario:
        """Return a copy with some parameters changed and checked.

        Parameters
        ----------
        **changes
            New values by parameter name.

        Raises
        ------
        ParameterError
            If a name is unknown or a value breaks its rule.
        """
        return Scenario.from_values({**self.values, **changes})

    def __getitem__(self, name: str) -> Any:
        """Return the value of the parameter `name`."""
        return self.values[name]

    @property
    def model(self) -> PlantModel:
        """Plant A, B, c.

        Raises
        ------
        ParameterError
            If the lengths of the matrices do not fit together.
        """
        n = len(self['output_vector'])
        if n == 0:
            raise ParameterError('output_vector', [], 'must not be empty')
        return PlantModel(
            state_matrix=self._matrix('state_matrix', rows=n, columns=n),
            input_matrix=self._matrix('input_matrix', rows=n, columns=None),
            output_vector=np.array(self['output_vector']),
        )

    @property
    def scene(self) -> PixelScene:
        """Pixel array: a regular grid where there is a pixel_pitch, else from pixel_offsets.

        Raises
        ------
        ParameterError
            If the lengths do not fit together.
        """
        if len(self['pixel_grid']) != 2:
            raise ParameterError('pixel_grid', self['pixel_grid'], 'must be [height, width]')
        height, width = self['pixel_grid']
        model = self.model
        if self['pixel_pitch']:
            return self._regular_scene(model, height, width)
        if self['pixel_origin']:
            raise ParameterError('pixel_origin', self['pixel_origin'], 'needs pixel_pitch')
        offsets = self._matrix('pixel_offsets', rows=None, columns=model.state_count)
        return PixelScene.from_offsets(model, offsets, height=height, width=width)

    @property
    def equilibrium(self) -> Equilibrium:
        """Stabilizable set-point nearest to set_point, and the input that holds it.

        Raises
        ------
        ParameterError
            If set_point is not stabilizable within set_point_tolerance.
        """
        return self.model.equilibrium(self['set_point'], tolerance=self['set_point_tolerance'])

    @property
    def initial_state(self) -> FloatArray:
        """Initial state x0, shape (n,).

        Raises
        ------
        ParameterError
            If it has not n entries.
        """
        state = np.array(self['initial_state'])
        n = len(self['output_vector'])
        if state.size != n:
            rule = f'must have as many entries as output_vector, {n}'
            raise ParameterError('initial_state', state.tolist(), rule)
        return state

    def reference_bounds(self, first_luminosity: FloatArray) -> ReferenceBounds:
        """Bounds m, M of the initial references.

        Parameters
        ----------
        first_luminosity
            y(0), shape (r,); used where reference_lower and reference_upper are empty.

        Raises
        ------
        ParameterError
            If only one of the two is given, a length does not fit or m > M.
        """
        lower, upper = self['reference_lower'], self['reference_upper']
        if not lower and not upper:
            return ReferenceBounds.around(first_luminosity, self['reference_uncertainty'])
        r = first_luminosity.size
        for name, bound in (('reference_lower', lower), ('reference_upper', upper)):
            if len(bound) not in (1, r):
                raise ParameterError(
                    name,
                    list(bound),
                    f'must have 1 or {r} entries, since the pixel array has {r} pixels',
                )
        return ReferenceBounds(
            lower=np.broadcast_to(np.array(lower), (r,)),
            upper=np.broadcast_to(np.array(upper), (r,)),
        )

    @property
    def model_reference_bounds(self) -> ReferenceBounds:
        """Bounds m, M for a consumer that sees no luminosity: y(0) from initial_state."""
        return self.reference_bounds(self.scene.luminosity(self.model, self.initial_state))

    @property
    def sampling_period_ns(self) -> int:
        """Sampling period in nanoseconds."""
        period_s: float = self['sampling_period']
        return round(period_s * NANOSECONDS)

    @property
    def sample_count(self) -> int:
        """Number of the last sample, ``duration / sampling_period``; 0 means no end."""
        duration_s: float = self['duration']
        if duration_s == 0:
            return 0
        return max(1, round(duration_s * NANOSECONDS / self.sampling_period_ns))

    @property
    def command_limit(self) -> FloatArray:
        """Largest ``|u_o|`` per input, shape (m,), infinite where there is none.

        Raises
        ------
        ParameterError
            If it has neither 0, 1 nor m entries.
        """
        m = self.model.input_count
        limits = self['command_limit'] or (np.inf,)
        if len(limits) not in (1, m):
            raise ParameterError('command_limit', list(limits), f'must have 0, 1 or {m} entries')
        return np.broadcast_to(np.array(limits), (m,))

    def _matrix(self, name: str, *, rows: int | None, columns: int | None) -> FloatArray:
        flat = np.array(self[name], dtype=np.float64)
        known = rows if rows is not None else columns
        assert known is not None
        wanted = rows * columns if rows is not None and columns is not None else None
        if flat.size == 0 or flat.size % known or (wanted is not None and flat.size != wanted):
            shape = f'{rows or "r"} x {columns or "m"}'
            raise ParameterError(
                name,
                list(self[name]),
                f'has {flat.size} entries, must have {shape} (row-major), since output_vector '
                f'has {len(self["output_vector"])}',
            )
        return flat.reshape(rows or -1, columns or -1)

    def _regular_scene(self, model: PlantModel, height: int, width: int) -> PixelScene:
        n = model.state_count
        pitch = np.array(self['pixel_pitch'])
        if pitch.size != 2 * n:
            raise ParameterError(
                'pixel_pitch',
                list(pitch),
                f'must have 2 x {n} entries, since output_vector has {n}',
            )
        origin = np.array(self['pixel_origin'] or (0.0,) * n)
        if origin.size != n:
            raise ParameterError('pixel_origin', list(origin), f'must have {n} entries')
        c = model.output_vector
        column_step, row_step = (pitch.reshape(2, n) @ c).tolist()
        columns = (np.arange(width) - (width - 1) / 2) * column_step
        rows = (np.arange(height) - (height - 1) / 2) * row_step
        offsets = float(origin @ c) + (rows[:, None] + columns[None, :])
        return PixelScene(brightness_offsets=offsets.ravel(), height=height, width=width)


class _RosLoader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-3 is a number, for YAML 1.1 it is a string; no name twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Mapping of a node; of two values for a name only one could hold."""
        names = [key.value for key, _ in node.value]
        for name in names:
            if names.count(name) > 1:
                raise yaml.constructor.ConstructorError(None, None, f'{name} is given twice')
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


_RosLoader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+.0123456789'),
)


def load_scenario(path: str | Path) -> Scenario:
    """Scenario of a ROS 2 parameter file (``/**: ros__parameters:``).

    Parameters
    ----------
    path
        YAML file.

    Raises
    ------
    ParameterError
        If the file can't be read, is no parameter file, names an unknown parameter, or a value
        breaks its rule.
    """
    try:
        document = yaml.load(Path(path).read_text(encoding='utf-8'), _RosLoader)
    except OSError as error:
        raise ParameterError('params-file', path, f'cannot be read: {error.strerror}') from None
    except (yaml.YAMLError, ValueError) as error:
        reason = ' '.join(str(error).split())
        raise ParameterError('params-file', path, f'is not YAML: {reason}') from None
    return Scenario.from_values(_merged_parameters(path, document))


def _merged_parameters(path: str | Path, document: object) -> dict[str, Any]:
    if not isinstance(document, dict):
        raise ParameterError('params-file', path, 'must be a mapping "/**: ros__parameters: ..."')
    merged: dict[str, Any] = {}
    for node, body in document.items():
        parameters = body.get('ros__parameters') if isinstance(body, dict) else None
        if not isinstance(parameters, dict):
            raise ParameterError('params-file', path, f'has no ros__parameters under {node}')
        flat = _flattened(parameters)
        merged.update({name: flat[name] for name in flat if not is_ros_parameter(name)})
    return merged


def _flattened(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Names of nested groups joined by dots, as ROS reads them."""
    flat: dict[str, Any] = {}
    for name, value in parameters.items():
        if isinstance(value, dict):
            flat.update({f'{name}.{key}': entry for key, entry in _flattened(value).items()})
        else:
            flat[str(name)] = value
    return flat
