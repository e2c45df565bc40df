"""Asks the running nodes for their parameters: the scenario, from the graph alone."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from dvs_interfaces.errors import ParameterError
from dvs_interfaces.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_interfaces.scenario import Scenario

_PATIENCE_S = 2.0
_NODES = (CAMERA, CONTROLLER, PLANT)


class _Question(NamedTuple):
    """Parameters asked for in one request."""

    node: str
    names: tuple[str, ...]


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
        self._values: dict[_Question, dict[str, Any]] = {}
        self._asked: dict[_Question, _Asked] = {}
        self._clients = {
            name: node.create_client(GetParameters, f'{name}/get_parameters') for name in _NODES
        }
        self._questions = [question for name in _NODES for question in _questions(name)]

    def ask(self) -> None:
        """Take the answers that came, and ask every node that is there again."""
        now = time.monotonic()
        for question in self._questions:
            asked = self._asked.get(question)
            if asked is not None and asked.future.done():
                self._take(question, asked.future.result())
                asked = None
            # A node that does not see us yet answers into the void: ask again.
            client = self._clients[question.node]
            overdue = asked is not None and now > asked.at + _PATIENCE_S
            if (asked is None or overdue) and client.service_is_ready():
                request = GetParameters.Request(names=list(question.names))
                self._asked[question] = _Asked(now, client.call_async(request))

    def _take(self, question: _Question, response: Any) -> None:
        if response is None:
            return
        values = [parameter_value_to_python(value) for value in response.values]
        # rclpy's answer is empty if a parameter is unset: an empty list.
        values = values or [None] * len(question.names)
        self._values[question] = dict(zip(question.names, values, strict=True))

    @property
    def complete(self) -> bool:
        """Whether plant and controller have answered; a camera may be hardware."""
        return all(q in self._values for q in self._questions if q.node != CAMERA)

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the answers, or None if there is none or it is not sound."""
        merged: dict[str, Any] = {}
        for question in self._questions:
            merged.update(self._values.get(question, {}))
        if not merged:
            return None
        try:
            return Scenario.from_values({name: _plain(value) for name, value in merged.items()})
        except ParameterError:
            return None


def _questions(node: str) -> list[_Question]:
    specs = SCHEMA.of_node(node)
    alone = [_Question(node, (spec.name,)) for spec in specs if spec.kind.is_array]
    scalars = tuple(spec.name for spec in specs if not spec.kind.is_array)
    return [_Question(node, scalars), *alone]


def _plain(value: Any) -> Any:
    if value is None:
        return ()
    return value if isinstance(value, bool | int | float | str) else list(value)
