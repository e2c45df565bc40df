"""The one way into rclpy and out again: start, executor, signals, end.

`rclpy.experimental.EventsExecutor` turns its loop several times as fast as the default executor,
which rebuilds its wait set at every turn. Its `spin()` and its `spin_once()` without a timeout
deadlock in rclpy 7.1, so a session always gives a timeout; see docs/architecture.md.
"""

from __future__ import annotations

import inspect
import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import TypeVar

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from dvs_common.errors import ParameterError
from dvs_common.node.clock_watch import ClockWatch
from dvs_common.node.direct_calls import DirectCalls
from dvs_common.node.middleware_periods import shorten_periods
from dvs_common.node.shared_memory import leave_shared_memory_where_needed
from dvs_common.program import StopSignal

# Longest wait for a message, and so the longest delay of a signal.
_TURN_S = 0.1
# Ports of DDS end there (RTPS 2.2, 9.6.1.1).
_LAST_DOMAIN = 232

_SWITCHES = (
    'RCUTILS_COLORIZED_OUTPUT',
    'RCUTILS_LOGGING_USE_STDOUT',
    'RCUTILS_LOGGING_BUFFERED_STREAM',
)

AnyNode = TypeVar('AnyNode', bound=Node)


class RosSession:
    """rclpy between start and end, with the nodes that are turned together.

    Parameters
    ----------
    stop
        Whether a signal has come.
    """

    def __init__(self, stop: StopSignal) -> None:
        self.stop = stop
        self.direct: DirectCalls | None = None
        self._executor = EventsExecutor()
        self._nodes: list[Node] = []
        self._clock = ClockWatch(self._executor.wake)

    def add(self, node: AnyNode) -> AnyNode:
        """Take a node in, and return it.

        Parameters
        ----------
        node
            Node to be turned, and destroyed at the end.
        """
        self._executor.add_node(node)
        self._nodes.append(node)
        return node

    @property
    def ended(self) -> bool:
        """Whether a signal has come or ROS was shut down."""
        return self.stop.received or not rclpy.ok()

    def turn(self, timeout_s: float = _TURN_S) -> None:
        """Handle what has come, or wait for something.

        Parameters
        ----------
        timeout_s
            Longest wait, s.
        """
        if self.direct is not None and self.direct.run():
            timeout_s = 0.0
        # What was taken down by a transition may still have an event in the queue.
        with suppress(InvalidHandle):
            self._executor.spin_once(timeout_sec=min(timeout_s, _TURN_S))
        if self._clock.was_set_back:
            self._clock.was_set_back = False
            self._start_timers_anew()

    def _start_timers_anew(self) -> None:
        """Let the executor wait for its timers anew, each from now on."""
        for node in self._nodes:
            for timer in node.timers:
                if not timer.is_canceled():
                    timer.reset()

    def spin(self, seconds: float) -> None:
        """Handle what comes for a while, or until a signal.

        Parameters
        ----------
        seconds
            Wall-clock time, s.
        """
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0 and not self.stop.received:
            self.turn(left)

    def close(self) -> None:
        """Take the nodes down.

        Of a program's nodes all goes but what Fast DDS deletes last, its participant: in that it
        can wait for ever, and until the program ends there is more to do (see `latest_end`).
        """
        self._clock.close()
        for node in self._nodes:
            self._executor.remove_node(node)
        self._executor.shutdown()
        for node in self._nodes:
            if self.stop.is_of_program:
                # A handle that is in use is not destroyed.
                node.handle.__enter__()
            node.destroy_node()


@contextmanager
def ros_session(arguments: Sequence[str] = ()) -> Iterator[RosSession]:
    """Start rclpy, and end it whatever happens.

    Parameters
    ----------
    arguments
        Command line with ROS arguments.

    Raises
    ------
    ParameterError
        If ROS_DOMAIN_ID is no domain, discovery is off, a switch of ROS's log is none, or ROS
        refuses the arguments or a node.
    """
    with StopSignal() as stop:
        domain = require_domain()
        require_discovery()
        require_switches_of_the_log()
        shorten_periods()
        leave_shared_memory_where_needed(domain)
        _know_modules_by_file()
        try:
            rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise _refused(arguments, error) from None
        try:
            session = RosSession(stop)
            try:
                yield session
            except RuntimeError as error:
                if 'error creating node' not in str(error):
                    raise
                raise _refused(arguments, error) from None
            finally:
                session.close()
        finally:
            rclpy.try_shutdown()


def require_domain() -> int:
    """Return the ROS domain, or raise `ParameterError` if ROS_DOMAIN_ID is none."""
    text = os.environ.get('ROS_DOMAIN_ID', '').strip()
    try:
        # As strtoul reads it: 0x10 is hexadecimal, 010 octal.
        domain = int(text, 8 if re.fullmatch('0[0-7]+', text) else 0) if text else 0
    except ValueError:
        domain = -1
    if not 0 <= domain <= _LAST_DOMAIN:
        raise ParameterError(
            'ROS_DOMAIN_ID', text, f'must be a whole number from 0 to {_LAST_DOMAIN}'
        )
    return domain


def require_discovery() -> None:
    """Raise `ParameterError` if the environment keeps nodes from finding each other."""
    discovery = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '')
    if discovery.upper() == 'OFF':
        raise ParameterError(
            'ROS_AUTOMATIC_DISCOVERY_RANGE',
            discovery,
            'lets no node find another: set it to LOCALHOST or SUBNET',
        )


def require_switches_of_the_log() -> None:
    """Raise `ParameterError` for a switch that ROS can't read: it would lose every line of log."""
    for name in _SWITCHES:
        value = os.environ.get(name, '')
        if value not in ('', '0', '1'):
            raise ParameterError(name, value, 'must be 0 or 1')


def _know_modules_by_file() -> None:
    """Give `inspect` the file of each module.

    rclpy asks for the module of every place that logs, for which `inspect` would resolve the paths
    of all modules first: a tenth of the time that a node takes to start.
    """
    for name, module in tuple(sys.modules.items()):
        if not isinstance(module, ModuleType):
            continue
        # To ask a module that waits for its first use by name would be that use.
        if file := object.__getattribute__(module, '__dict__').get('__file__'):
            inspect.modulesbyfile.setdefault(file, name)


def own_arguments(arguments: Sequence[str]) -> list[str]:
    """Return what of a command line is not ROS's, the program's name first.

    Parameters
    ----------
    arguments
        Command line with ROS arguments.

    Raises
    ------
    ParameterError
        If ROS refuses its arguments.
    """
    try:
        return list(remove_ros_args(list(arguments)))
    except RuntimeError as error:
        raise _refused(arguments, error) from None


def _refused(arguments: Sequence[str], error: RuntimeError) -> ParameterError:
    message = ' '.join(str(error).split())
    if 'initialize logging' in message:
        name = next((n for n in ('ROS_LOG_DIR', 'ROS_HOME') if os.environ.get(n)), 'HOME')
        return ParameterError(
            name,
            os.environ.get(name, ''),
            'has no folder for the log that can be written: set HOME, ROS_HOME or ROS_LOG_DIR to '
            f'one ({message})',
        )
    if 'Unable to resolve peer' in message:
        return ParameterError(
            'ROS_STATIC_PEERS',
            os.environ.get('ROS_STATIC_PEERS', ''),
            'has a host that has no IPv4 address here',
        )
    security = os.environ.get('ROS_SECURITY_ENABLE', '')
    if 'initialize rcl' in message and security.lower() == 'true':
        return ParameterError(
            'ROS_SECURITY_ENABLE',
            security,
            'needs ROS_SECURITY_KEYSTORE, and in it an enclave of this program (docs/security.md)',
        )
    if 'Sequence should be of same type' in message:
        message += ' (ROS wants all numbers of a list alike: write 1.0 beside 0.5, not 1)'
    first = list(arguments).index('--ros-args') + 1 if '--ros-args' in arguments else 0
    return ParameterError('ros-args', ' '.join(arguments[first:]), message)
