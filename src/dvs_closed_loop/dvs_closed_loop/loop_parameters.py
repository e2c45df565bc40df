"""Asks the running nodes for their parameters: the scenario, from the graph alone."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from dvs_interfaces.errors import ParameterError
from dvs_interfaces.parameters import CAMERA, CONTROLLER, PLANT, SCHEMA
from dvs_interfaces.scenario import Scenario


class LoopParameters:
    """Parameters of the loop's nodes, as far as they have answered.

    Parameters
    ----------
    node
        Node that carries the service clients; its namespace is that of the loop.
    """

    def __init__(self, node: Node) -> None:
        self._values: dict[str, dict[str, Any]] = {}
        self._pending: dict[str, Any] = {}
        self._clients = {
            name: node.create_client(GetParameters, f'{name}/get_parameters')
            for name in (PLANT, CAMERA, CONTROLLER)
        }

    def ask(self) -> None:
        """Ask every node that is there; answers come while the executor turns."""
        for name, client in self._clients.items():
            pending = self._pending.get(name)
            if (pending is not None and not pending.done()) or not client.service_is_ready():
                continue
            names = [spec.name for spec in SCHEMA.of_node(name)]
            self._pending[name] = client.call_async(GetParameters.Request(names=names))
            self._pending[name].add_done_callback(self._taker(name, names))

    def _taker(self, node_name: str, names: list[str]) -> Any:
        def take(future: Any) -> None:
            response = future.result()
            if response is not None and len(response.values) == len(names):
                values = map(parameter_value_to_python, response.values)
                self._values[node_name] = dict(zip(names, values, strict=True))

        return take

    @property
    def complete(self) -> bool:
        """Whether plant and controller have answered; a camera may be hardware."""
        return PLANT in self._values and CONTROLLER in self._values

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the answers, or None if there is none or it is not sound."""
        merged: dict[str, Any] = {}
        for name in (CAMERA, CONTROLLER, PLANT):
            own = self._values.get(name, {})
            merged.update({key: value for key, value in own.items() if value is not None})
        if not merged:
            return None
        try:
            return Scenario.from_values({key: _plain(value) for key, value in merged.items()})
        except ParameterError:
            return None


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else list(value)
