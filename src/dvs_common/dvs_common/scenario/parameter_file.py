"""Parameter files as ROS 2 reads them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from dvs_common.errors import ParameterError
from dvs_common.scenario.schema import is_ros_parameter

_PARAMETERS = 'ros__parameters'
_DEEPEST = 50
_WILDCARDS = {'/*': r'/\w+', '/**': r'(/\w+)*'}


class _RosLoader(yaml.SafeLoader):
    """YAML as ROS reads it: 1e-3 is a number, no name comes twice, nothing is an alias."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Next node, refused in time: a few lines of aliases would fill the memory.

        Parameters
        ----------
        parent
            Node that holds it.
        index
            Its place there.
        """
        if self.check_event(yaml.AliasEvent):
            raise self._refusal('ROS knows no aliases')
        if self._depth > _DEEPEST:
            raise self._refusal(f'is nested more than {_DEEPEST} deep')
        self._depth += 1
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def _refusal(self, reason: str) -> yaml.YAMLError:
        return yaml.composer.ComposerError(None, None, f'{reason} (line {self.line + 1})')

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """What a parameter file has for the nodes whose full names match a pattern.

    Parameters
    ----------
    key
        Key in the file; of nested namespaces, joined by slashes.
    values
        Values by flat parameter name, without ROS's own.
    """

    key: str
    values: Mapping[str, Any]

    @property
    def pattern(self) -> str:
        """Full name that nodes are matched with: ``*`` is one token, ``**`` any number of them."""
        return self.key if self.key.startswith('/') else f'/{self.key}'

    def matches(self, full_name: str) -> bool:
        """Whether rcl gives a node these values.

        Parameters
        ----------
        full_name
            Namespace and name of the node, as in ``/left/plant_sim``.
        """
        tokens = re.split(r'(/\*{1,2})', self.pattern)
        pattern = ''.join(_WILDCARDS.get(token, re.escape(token)) for token in tokens)
        return re.fullmatch(pattern, full_name) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterFile:
    """A parameter file with a section for each node, or for all.

    Parameters
    ----------
    path
        Where it is.
    sections
        In the order of the file.
    """

    path: Path
    sections: tuple[Section, ...]

    def values_of(self, full_name: str) -> dict[str, Any]:
        """Values that a node gets: of two sections with a name, the later one counts.

        Parameters
        ----------
        full_name
            Namespace and name of the node.
        """
        values: dict[str, Any] = {}
        for section in self.sections:
            if section.matches(full_name):
                values.update(section.values)
        return values


def read_parameter_file(path: str | Path) -> ParameterFile:
    """Read a ROS 2 parameter file.

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
    if not isinstance(document, dict):
        raise ParameterError('params-file', path, 'must be a mapping "/**: ros__parameters: ..."')
    sections = tuple(
        section for key, body in document.items() for section in _sections(path, str(key), body)
    )
    return ParameterFile(path=Path(path), sections=sections)


def _sections(path: str | Path, key: str, body: object) -> Iterator[Section]:
    """Section of a node, or those of the nodes in a namespace."""
    nested = dict(body) if isinstance(body, dict) else {}
    parameters = nested.pop(_PARAMETERS, None)
    if parameters is None and nested and all(isinstance(inner, dict) for inner in nested.values()):
        for name, inner in nested.items():
            yield from _sections(path, f'{key}/{name}'.replace('//', '/'), inner)
        return
    if not isinstance(parameters, dict) or nested:
        raise ParameterError('params-file', path, f'has no {_PARAMETERS} under {key}')
    flat = _flattened(parameters)
    values = {name: flat[name] for name in flat if not is_ros_parameter(name)}
    yield Section(key=key, values=values)


def _flattened(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Names of nested groups joined by dots, as ROS reads them."""
    flat: dict[str, Any] = {}
    for name, value in parameters.items():
        if isinstance(value, dict):
            flat.update({f'{name}.{key}': entry for key, entry in _flattened(value).items()})
        else:
            flat[str(name)] = value
    return flat
