"""Runs the nodes of a process: from the command line to the exit code."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import TransitionCallbackReturn

from dvs_common.errors import ParameterError
from dvs_common.latest_end import end_soon
from dvs_common.node.direct_calls import DirectCalls
from dvs_common.node.managed_node import ManagedNode
from dvs_common.node.session import RosSession, own_arguments, ros_session
from dvs_common.program import ignore_signals
from dvs_common.scenario.parameter_file import read_parameter_file

_USAGE_ERROR = 2
_USAGE = 'all that is for ROS follows --ros-args: --ros-args --params-file FILE -p NAME:=VALUE'
_HELP = """usage: {program} [--ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...]

A ROS 2 node. Without a parameter file it runs the built-in scenario, config/mirror_r3.yaml;
docs/parameters.md has all parameters, docs/wire_contract.md the topics."""


def run_nodes(
    factories: Sequence[Callable[[], ManagedNode]],
    arguments: Sequence[str] | None = None,
    *,
    options: Sequence[str] = (),
) -> int:
    """Start nodes, spin until a signal or until one of them finishes, and take them down.

    Parameters
    ----------
    factories
        Each makes one node.
    arguments
        Command line with the program's name and ROS arguments; `sys.argv` by default.
    options
        What else may stand in the command line.

    Returns
    -------
    int
        Exit code: 0 after a signal or a successful finish, 2 if the nodes can't start.
    """
    command_line = sys.argv if arguments is None else list(arguments)
    code = _exit_code(factories, command_line, options)
    end_soon(code)
    return code


def _exit_code(
    factories: Sequence[Callable[[], ManagedNode]],
    command_line: Sequence[str],
    options: Sequence[str],
) -> int:
    try:
        answer = answer_of(command_line, help_text=_HELP, options=options)
        if answer is not None:
            return answer
        with ros_session(command_line) as ros:
            try:
                nodes = [ros.add(factory()) for factory in factories]
                if len(nodes) > 1:
                    ros.direct = DirectCalls()
                    for node in nodes:
                        node.direct = ros.direct
                for path in _parameter_files(command_line):
                    _warn_of_a_file_for_others(path, nodes)
                return _spin(ros, nodes)
            finally:
                ignore_signals()
    except ParameterError as error:
        print(f'cannot start: {error}', file=sys.stderr)
        return _USAGE_ERROR
    except ExternalShutdownException:
        return 0


def answer_of(
    command_line: Sequence[str], *, help_text: str, options: Sequence[str] = ()
) -> int | None:
    """Answer a command line that asks for help or is mistaken.

    Parameters
    ----------
    command_line
        The program's name and its arguments.
    help_text
        What ``--help`` prints, with ``{program}`` for the name.
    options
        What else may stand in the command line.

    Returns
    -------
    int or None
        Exit code; None for a command line to start with.

    Raises
    ------
    ParameterError
        If ROS refuses its arguments.
    """
    program, *others = own_arguments(command_line)
    if '--help' in others or '-h' in others:
        print(help_text.format(program=Path(program).name))
        return 0
    for argument in others:
        if argument not in options:
            print(f'cannot start: unknown argument {argument}; {_USAGE}', file=sys.stderr)
            return _USAGE_ERROR
    return None


def _parameter_files(command_line: Sequence[str]) -> list[str]:
    return [path for option, path in pairwise(command_line) if option == '--params-file']


def _warn_of_a_file_for_others(path: str, nodes: Sequence[ManagedNode]) -> None:
    """Warn a node that gets nothing from a file: ROS passes it over without a message."""
    sections = read_parameter_file(path).sections
    for node in nodes:
        name = node.get_fully_qualified_name()
        if not any(section.matches(name) for section in sections):
            keys = ', '.join(section.key for section in sections)
            node.get_logger().warning(f'{path} has nothing for {name}; it has values for {keys}')


def _spin(ros: RosSession, nodes: Sequence[ManagedNode]) -> int:
    for node in nodes:
        if node.autostart and not _start(node):
            return _USAGE_ERROR
    # What start-up has made stays: no later collection has to walk through it.
    gc.freeze()
    while not ros.stop.received:
        ros.turn()
        for node in nodes:
            if node.exit_code is not None:
                return node.exit_code
    return 0


def _start(node: ManagedNode) -> bool:
    success = TransitionCallbackReturn.SUCCESS
    return bool(node.trigger_configure() == success and node.trigger_activate() == success)
