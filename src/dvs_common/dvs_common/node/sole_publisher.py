"""Several publishers of a topic that must have one."""

from __future__ import annotations

from rclpy.node import Node

# The middleware gives up a killed process only after a while.
_GHOST = ' (unless one was killed in the last seconds)'
# What rmw has in place of a name that has not arrived yet, and how many looks it may take.
_UNKNOWN = '_NODE_NAME_UNKNOWN_'
_LOOKS_FOR_A_NAME = 3


class SolePublisher:
    """Looks whether a topic has one publisher.

    Parameters
    ----------
    node
        Node that looks.
    topic
        Topic of which one publisher is right: messages of several can't be told apart.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self._unnamed = 0

    def rivals(self) -> str:
        """What is wrong, with the names of the nodes; empty where nothing is.

        A publisher is found before the name of its node. Some looks are waited for the name.
        """
        names = sorted(
            'a publisher without a node'
            if info.node_name == _UNKNOWN
            else f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(self._topic)
        )
        unnamed = any(not name.startswith('/') for name in names)
        self._unnamed = self._unnamed + 1 if unnamed else 0
        if len(names) < 2 or 0 < self._unnamed <= _LOOKS_FOR_A_NAME:
            return ''
        ghost = '' if len(set(names)) == len(names) else _GHOST
        return f'{self._topic} has {len(names)} publishers: {", ".join(names)}{ghost}'
