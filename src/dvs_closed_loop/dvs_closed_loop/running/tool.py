"""A node for a command-line tool: made, turned and taken down in one place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rclpy.node import Node

from dvs_common.node.node_plan import checked_namespace, namespace_remappings
from dvs_common.node.session import RosSession, ros_session
from dvs_common.program import StopSignal


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """A node, and the session that turns it.

    Parameters
    ----------
    node
        The node.
    session
        Its session.
    """

    node: Node
    session: RosSession

    @property
    def stop(self) -> StopSignal:
        """Whether the user has asked for a stop."""
        return self.session.stop

    def spin(self, seconds: float) -> None:
        """Handle what comes for `seconds`, or until the user stops it.

        Parameters
        ----------
        seconds
            Wall-clock time, s.
        """
        self.session.spin(seconds)


@contextmanager
def tool_node(name: str, namespace: str, ros_arguments: Sequence[str]) -> Iterator[Tool]:
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
    with ros_session(ros_arguments) as session:
        remappings = namespace_remappings(absolute)
        renamed = [part for old, new in remappings for part in ('-r', f'{old}:={new}')]
        arguments = ['--ros-args', *renamed] if renamed else []
        node = session.add(Node(name, namespace=absolute or None, cli_args=arguments))
        yield Tool(node=node, session=session)
