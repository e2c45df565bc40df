"""Node `hinf_controller`: from polarity events to the plant's command."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64MultiArray

from dvs_hinf_controller.design import design_from_scenario
from dvs_hinf_controller.event_controller import EventController
from dvs_hinf_controller.start_up import start_up_report
from dvs_interfaces import topics
from dvs_interfaces.events import parse_events
from dvs_interfaces.managed_node import ManagedNode
from dvs_interfaces.messages import Vector, pack_array, pack_command
from dvs_interfaces.parameters import CONTROLLER
from dvs_interfaces.scenario import Scenario
from dvs_interfaces.spin import run_nodes


class HinfControllerNode(ManagedNode):
    """Takes `events`; publishes `command`, and `estimate` while somebody listens."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__(CONTROLLER, **node_arguments)

    def configure(self, scenario: Scenario) -> None:
        """Design the controller and report what it promises; see `ManagedNode.configure`."""
        self._design = design_from_scenario(scenario)
        self._event_threshold = scenario['event_threshold']
        self._command_limit = scenario.command_limit
        self._names = tuple(f'u{i + 1}' for i in range(self._design.problem.model.input_count))
        qos = topics.handshake_qos(scenario['mode'])
        self._command_publisher = self.advertise(JointState, topics.COMMAND, qos)
        self._estimate_publisher = self.advertise(
            Float64MultiArray, topics.ESTIMATE, topics.stream_qos()
        )
        self.listen(PointCloud2, topics.EVENTS, self._take, qos)
        report = start_up_report(
            self._design,
            event_threshold=self._event_threshold,
            sampling_period=scenario['sampling_period'],
        )
        self.get_logger().info(report.text)
        for warning in report.warnings:
            self.get_logger().warning(warning)

    def activate(self) -> None:
        """Begin with what is known of the references before any event."""
        self._controller = EventController(
            self._design.problem,
            self._design.controller,
            event_threshold=self._event_threshold,
            command_limit=self._command_limit,
        )
        self._lost_events = 0

    def _take(self, message: bytes) -> None:
        packet = parse_events(message)
        report = self._controller.take(packet)
        if report.restarted:
            self.get_logger().warning('time went back: the estimator and K start anew')
        if report.lost_events:
            self._lost_events += report.lost_events
            self.get_logger().error(
                f'{report.lost_events} events were lost before {packet.stamp_ns * 1e-9:.6f} s '
                f'({self._lost_events} in all): the estimate is biased'
            )
        self._command_publisher.publish(
            pack_command(
                Vector(
                    stamp_ns=packet.stamp_ns, names=self._names, values=self._controller.command
                )
            )
        )
        if self._estimate_publisher.get_subscription_count():
            self._estimate_publisher.publish(pack_array(self._controller.estimate))


def main() -> int:
    """Run the node until a signal."""
    return run_nodes([HinfControllerNode])
