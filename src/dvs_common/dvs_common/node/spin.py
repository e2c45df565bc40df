"""The one executor loop of all nodes: fast, and ended cleanly by SIGINT, SIGTERM or a node.

`rclpy.experimental.EventsExecutor` turns the loop several times as fast as the default executor,
which rebuilds its wait set at every turn. Its `spin()` and its `spin_once()` without a timeout
deadlock in rclpy 7.1, so the loop here always gives a timeout; see docs/architecture.md.
"""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from dvs_common.errors import ParameterError
from dvs_common.node.managed_node import ManagedNode

# Longest wait for a message, and so the longest delay of a signal.
_TURN_S = 0.1
_USAGE_ERROR = 2
_USAGE = 'all that is for ROS follows --ros-args: --ros-args --params-file FILE -p NAME:=VALUE'
_HELP = """usage: {program} [--ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...]

A ROS 2 node. Without a parameter file it runs the built-in scenario, config/mirror_r3.yaml;
docs/parameters.md has all parameters, docs/wire_contract.md the topics."""


class StopSignal:
    """Remembers SIGINT and SIGTERM, which end a node in order instead of with a traceback."""

    def __init__(self) -> None:
        self.received = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._receive)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True


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
    stop = StopSignal()
    try:
        answer = _answer(command_line, options)
        if answer is not None:
            return answer
        rclpy.init(args=command_line, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        print(f'cannot start: {_explained(str(error))}', file=sys.stderr)
        return _USAGE_ERROR
    nodes: list[ManagedNode] = []
    try:
        for factory in factories:
            nodes.append(factory())
        return _spin(nodes, stop)
    except ParameterError as error:
        print(f'cannot start: {error}', file=sys.stderr)
        return _USAGE_ERROR
    except ExternalShutdownException:
        return 0
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        for node in nodes:
            node.close()
        rclpy.try_shutdown()


def _answer(command_line: Sequence[str], options: Sequence[str]) -> int | None:
    """Exit code of a command line that asks for help or is mistaken; None for one to start."""
    program, *others = remove_ros_args(command_line)
    if '--help' in others or '-h' in others:
        print(_HELP.format(program=Path(program).name))
        return 0
    for argument in others:
        if argument not in options:
            print(f'cannot start: unknown argument {argument}; {_USAGE}', file=sys.stderr)
            return _USAGE_ERROR
    return None


def _explained(rcl_error: str) -> str:
    message = ' '.join(rcl_error.split())
    if 'Sequence should be of same type' in message:
        message += ' (ROS wants all numbers of a list alike: write 1.0 beside 0.5, not 1)'
    return message


def _spin(nodes: Sequence[ManagedNode], stop: StopSignal) -> int:
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        for node in nodes:
            if node.autostart and not _start(node):
                return _USAGE_ERROR
        # What start-up has made stays: no later collection has to walk through it.
        gc.freeze()
        while not stop.received:
            # What was taken down by a transition may still have an event in the queue.
            with suppress(InvalidHandle):
                executor.spin_once(timeout_sec=_TURN_S)
            for node in nodes:
                if node.exit_code is not None:
                    return node.exit_code
        return 0
    finally:
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()


def _start(node: ManagedNode) -> bool:
    success = TransitionCallbackReturn.SUCCESS
    return bool(node.trigger_configure() == success and node.trigger_activate() == success)
