"""What a plant node and the driver that passes its time use of each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from dvs_common.node.health import Trouble
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import Vector
from dvs_plant_sim.dynamics import Dynamics
from dvs_plant_sim.small_step import SmallStep


class SampledPlant(Protocol):
    """A node that a driver samples; see `PlantNode` and `ManagedNode`."""

    plant: Dynamics
    exit_code: int | None

    def activate(self) -> None:
        """Start anew at the initial state."""

    def publish_sample(self, stamp_ns: int) -> None:
        """Publish state and luminosity; see `PlantNode.publish_sample`."""

    def publish_image(self, image: bytes, stamp_ns: int) -> None:
        """Publish an image of the present state; see `PlantNode.publish_image`."""

    def small_step(self) -> SmallStep | None:
        """Return the fast path of a step, where there is one; see `PlantNode.small_step`."""

    def send_again(self) -> None:
        """Publish the last luminosity once more."""

    def checked_command(self, message: bytes) -> Vector:
        """Return a command that the plant can take; see `PlantNode.checked_command`."""

    def missing_partner(self) -> str:
        """Why no command comes, in words."""

    def advertise_on_demand(self, message_type: type, topic: str, qos: Any) -> Any:
        """Publisher that reports its subscribers; see `ManagedNode.advertise_on_demand`."""

    def subscribe(
        self, message_type: type, topic: str, handler: Callable[[bytes], None], qos: Any
    ) -> None:
        """Subscribe to serialized messages; see `ManagedNode.subscribe`."""

    def every(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Wall-clock timer; see `ManagedNode.every`."""

    def count_publishers(self, topic: str) -> int:
        """Return how many publishers a topic has; see `rclpy.node.Node.count_publishers`."""

    def finish(self, exit_code: int, reason: str) -> None:
        """End the process; see `ManagedNode.finish`."""

    def get_logger(self) -> Any:
        """Logger of the node."""

    def get_clock(self) -> Any:
        """Clock of the node."""


class Driver(Protocol):
    """Passes the time of a plant: decides when it is sampled and advanced."""

    def start(self) -> None:
        """Begin with the plant at its initial state."""

    def adopt(self, scenario: Scenario) -> None:
        """Take over changed parameters; see `LockstepDriver.adopt`."""

    def troubles(self) -> Sequence[Trouble]:
        """What is wrong with the passing of time."""

    def figures(self) -> dict[str, object]:
        """Figures for the health of the node."""
