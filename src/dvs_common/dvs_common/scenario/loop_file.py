"""What each node of a loop gets from a parameter file, and the values that a tool works with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dvs_common.errors import ParameterError
from dvs_common.scenario.nodes import NODES, PLANT
from dvs_common.scenario.parameter_file import ParameterFile, read_parameter_file
from dvs_common.scenario.parameters import SCHEMA


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopValues:
    """Values of the nodes of a loop; they may differ from node to node, as in ROS.

    Parameters
    ----------
    given
        What the file has for each node, by the node's name.
    """

    given: Mapping[str, Mapping[str, Any]]

    def merged(self, first: str | None = None) -> dict[str, Any]:
        """Values of all parameters that are given, each as a node that reads it gets it.

        Where nodes differ the plant counts before the camera, and the camera before the
        controller: what happens, and not what a node assumes.

        Parameters
        ----------
        first
            Node that counts before all others: what that node assumes.
        """
        order = sorted(NODES, key=lambda node: node != first)
        merged: dict[str, Any] = {}
        for name in self._names:
            readers = _readers(name) or [node for node in NODES if name in self.given[node]]
            chosen = next(node for node in order if node in readers)
            if name in self.given[chosen]:
                merged[name] = self.given[chosen][name]
        return merged

    def require_alike(self) -> None:
        """Raise `ParameterError` for a parameter of which nodes have different values."""
        for name in self._names:
            if name not in SCHEMA:
                continue
            spec = SCHEMA[name]
            found = {
                node: spec.validate(self.given[node].get(name, spec.default))
                for node in _readers(name)
            }
            if len(set(found.values())) > 1:
                values = ', '.join(f'{value} for {node}' for node, value in found.items())
                raise ParameterError(name, values, 'must be the same for every node here')

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for node in NODES for name in self.given[node]))


def read_loop_values(path: str | Path, namespace: str | None = None) -> LoopValues:
    """Values that a parameter file has for the nodes of a loop.

    Parameters
    ----------
    path
        ROS 2 parameter file.
    namespace
        Absolute namespace of the loop, empty for the root; None for that of the file's keys.

    Raises
    ------
    ParameterError
        If the file can't be read or is no parameter file, a key matches no node of the loop, a
        parameter is given to none of the nodes that read it, or a value is not allowed.
    """
    file = read_parameter_file(path)
    space = _namespace_of(file) if namespace is None else namespace
    full_names = {node: f'{space}/{node}' for node in NODES}
    for section in file.sections:
        if not any(map(section.matches, full_names.values())):
            raise ParameterError(
                'params-file',
                path,
                f'has values for {section.key}, which is no node of this loop: they are '
                f'{", ".join(full_names.values())}',
            )
    given = {node: file.values_of(name) for node, name in full_names.items()}
    for values in given.values():
        SCHEMA.validate(values)
    _require_read(given)
    return LoopValues(given=given)


def _namespace_of(file: ParameterFile) -> str:
    """Namespace in which all sections match, of those that the keys name; the root otherwise."""
    for space in sorted({_namespace_in(section.pattern) for section in file.sections}):
        full_names = [f'{space}/{node}' for node in NODES]
        if all(any(map(section.matches, full_names)) for section in file.sections):
            return space
    return ''


def _namespace_in(pattern: str) -> str:
    """Shortest namespace that the pattern of a node's full name allows."""
    return pattern.rpartition('/')[0].replace('/**', '').replace('/*', '/any')


def _readers(name: str) -> tuple[str, ...]:
    """Nodes that read a parameter; none for what only tools read."""
    if name not in SCHEMA:
        return (PLANT,)
    return tuple(node for node in NODES if node in SCHEMA[name].nodes)


def _require_read(given: Mapping[str, Mapping[str, Any]]) -> None:
    for node, values in given.items():
        for name, value in values.items():
            readers = _readers(name)
            if readers and not any(name in given[reader] for reader in readers):
                raise ParameterError(
                    name,
                    value,
                    f'is given to {node}, which does not read it: {" and ".join(readers)} would',
                )
