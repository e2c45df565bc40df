"""Asks the running nodes for their parameters: the scenario, from the graph alone."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from dvs_common.errors import ParameterError
from dvs_common.node.ros_parameters import plain
from dvs_common.scenario.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_common.scenario.scenario import Scenario

_PATIENCE_S = 2.0
_NAMES = {
    node: [spec.name for spec in SCHEMA.of_node(node)] for node in (CONTROLLER, CAMERA, PLANT)
}


class _Asked(NamedTuple):
    """A request on its way."""

    at: float
    future: Any


class LoopParameters:
    """Parameters of the loop's nodes, as far as they have answered.

    Parameters
    ----------
    node
        Node that carries the service clients; its namespace is that of the loop.
    """

    def __init__(self, node: Node) -> None:
        self._values: dict[str, dict[str, Any]] = {}
        self._asked: dict[str, _Asked] = {}
        self._clients = {
            name: node.create_client(GetParameters, f'{name}/get_parameters') for name in _NAMES
        }

    def ask(self) -> None:
        """Take the answers that came, and ask every node that is there again."""
        now = time.monotonic()
        for node, client in self._clients.items():
            asked = self._asked.get(node)
            if asked is not None and asked.future.done():
                self._take(node, asked.future.result())
                asked = None
            # A node that does not see us yet answers into the void: ask again.
            overdue = asked is not None and now > asked.at + _PATIENCE_S
            if (asked is None or overdue) and client.service_is_ready():
                request = GetParameters.Request(names=_NAMES[node])
                self._asked[node] = _Asked(now, client.call_async(request))

    def forget(self) -> None:
        """Forget all answers: they are those of a loop that is gone."""
        self._values.clear()
        self._asked.clear()

    def _take(self, node: str, response: Any) -> None:
        # The answer of a node that does not know all of these names, as a driver, is empty.
        if response is not None and len(response.values) == len(_NAMES[node]):
            values = map(parameter_value_to_python, response.values)
            self._values[node] = dict(zip(_NAMES[node], map(plain, values), strict=True))

    @property
    def complete(self) -> bool:
        """Whether plant and controller have answered; a camera may be hardware."""
        return {PLANT, CONTROLLER} <= set(self._values)

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the answers, or None if there is none or it is not sound."""
        merged: dict[str, Any] = {}
        for node in _NAMES:
            merged.update(self._values.get(node, {}))
        if not merged:
            return None
        try:
            return Scenario.from_values(merged)
        except ParameterError:
            return None
