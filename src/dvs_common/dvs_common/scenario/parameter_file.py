"""Parameter files as ROS 2 reads them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from dvs_common.errors import ParameterError
from dvs_common.scenario.schema import is_ros_parameter


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


def read_parameters(path: str | Path) -> dict[str, Any]:
    """Parameters of a ROS 2 parameter file (``/**: ros__parameters:``) by their flat names.

    Parameters
    ----------
    path
        YAML file.

    Raises
    ------
    ParameterError
        If the file can't be read or is no parameter file.
    """
    try:
        document = yaml.load(Path(path).read_text(encoding='utf-8'), _RosLoader)
    except OSError as error:
        raise ParameterError('params-file', path, f'cannot be read: {error.strerror}') from None
    except (yaml.YAMLError, ValueError) as error:
        reason = ' '.join(str(error).split())
        raise ParameterError('params-file', path, f'is not YAML: {reason}') from None
    return _merged_parameters(path, document)


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
