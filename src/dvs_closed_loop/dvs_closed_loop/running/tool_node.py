"""A node for a command-line tool: made, turned and taken down in one place."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dvs_common.errors import ParameterError
from dvs_common.node.node_plan import checked_namespace, namespace_remappings
from dvs_common.node.spin import StopSignal

_TURN_S = 0.05


class ToolNode:
    """A node, its executor, and the wish of the user to stop.

    Parameters
    ----------
    node
        The node.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self.stop = StopSignal()
        self._executor = EventsExecutor()
        self._executor.add_node(node)

    def spin(self, seconds: float) -> None:
        """Handle what comes for `seconds`, or until the user wants to stop.

        Parameters
        ----------
        seconds
            Wall-clock time, s.
        """
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0 and not self.stop.received:
            self._executor.spin_once(timeout_sec=min(left, _TURN_S))

    def close(self) -> None:
        """Take the node down."""
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()


@contextmanager
def tool_node(name: str, namespace: str, ros_arguments: Sequence[str]) -> Iterator[ToolNode]:
    """Node of a tool, with rclpy started around it.

    Parameters
    ----------
    name
        Name of the node.
    namespace
        Namespace of the loop; empty for none.
    ros_arguments
        From ``--ros-args`` on, for remaps.

    Raises
    ------
    ParameterError
        If ROS refuses the namespace or the arguments.
    """
    absolute = checked_namespace(namespace)
    try:
        rclpy.init(args=list(ros_arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        message = ' '.join(str(error).split())
        raise ParameterError('ros-args', ' '.join(ros_arguments), message) from None
    try:
        remappings = namespace_remappings(absolute)
        renamed = [part for old, new in remappings for part in ('-r', f'{old}:={new}')]
        arguments = ['--ros-args', *renamed] if renamed else []
        tool = ToolNode(Node(name, namespace=absolute or None, cli_args=arguments))
        try:
            yield tool
        finally:
            tool.close()
    finally:
        rclpy.try_shutdown()
