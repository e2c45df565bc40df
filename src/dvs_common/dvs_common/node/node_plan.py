"""How a node is started: what a process, a launch file and a person on the command line share."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dvs_common.errors import ParameterError
from dvs_common.wire import topics

LOG_LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')

_TOKEN = r'[A-Za-z_][A-Za-z0-9_]*'
_NAMESPACE = re.compile(rf'/?{_TOKEN}(/{_TOKEN})*')


def checked_namespace(namespace: str) -> str:
    """Absolute form of a namespace; empty for the root.

    Parameters
    ----------
    namespace
        Name as the user writes it, with or without the leading slash.

    Raises
    ------
    ParameterError
        If it is no ROS name.
    """
    if namespace in ('', '/'):
        return ''
    if not _NAMESPACE.fullmatch(namespace):
        raise ParameterError(
            'namespace',
            namespace,
            'must be names of letters, digits and _ joined by /, as in left or cell/left',
        )
    return '/' + namespace.lstrip('/')


def namespace_remappings(namespace: str) -> tuple[tuple[str, str], ...]:
    """Remappings that keep a loop within its namespace: its clock becomes NAMESPACE/clock.

    All other names of the loop are relative and follow by themselves; `/diagnostics` stays, since
    its readers collect from everywhere and tell nodes apart by their names.

    Parameters
    ----------
    namespace
        Absolute namespace, or empty.
    """
    return ((topics.CLOCK, topics.CLOCK.lstrip('/')),) if namespace else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class NodePlan:
    """One node to be started.

    Parameters
    ----------
    package
        Package of the executable; empty for a program outside of any package.
    executable
        Name of the executable, or path of the program.
    parameter_file
        Scenario, or None for the defaults.
    parameters
        Values that differ from the file.
    namespace
        Absolute namespace, or empty.
    options
        Options that are not ROS's.
    log_level
        One of `LOG_LEVELS`, or empty for ROS's own.
    """

    package: str
    executable: str
    parameter_file: Path | None = None
    parameters: Mapping[str, object] = field(default_factory=dict)
    namespace: str = ''
    options: tuple[str, ...] = ()
    log_level: str = ''

    @property
    def name(self) -> str:
        """Name of the program."""
        return Path(self.executable).name

    @property
    def remappings(self) -> tuple[tuple[str, str], ...]:
        """Pairs of a name and what takes its place."""
        return namespace_remappings(self.namespace)

    @property
    def arguments(self) -> list[str]:
        """Command line after the executable, as `ros2 run` takes it."""
        arguments = [*self.options, '--ros-args']
        if self.parameter_file is not None:
            arguments += ['--params-file', str(self.parameter_file)]
        for name, value in self.parameters.items():
            arguments += ['-p', f'{name}:={_yaml(value)}']
        if self.namespace:
            arguments += ['-r', f'__ns:={self.namespace}']
        for old, new in self.remappings:
            arguments += ['-r', f'{old}:={new}']
        return arguments + self.log_arguments

    @property
    def log_arguments(self) -> list[str]:
        """Arguments of ROS that set the level of the log."""
        return ['--log-level', self.log_level] if self.log_level else []


def _yaml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
