"""Node `hinf_controller`: from polarity events to the plant's command."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import Empty, Float64MultiArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.node.health import Health, Level, RateMeter, Trouble
from dvs_common.node.managed_node import ManagedNode
from dvs_common.node.spin import run_nodes
from dvs_common.scenario.parameters import CONTROLLER
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.anchor import parse_anchor
from dvs_common.wire.command_copy import command_copy
from dvs_common.wire.events import (
    EVENT_DTYPE,
    NO_EVENTS,
    EventPacket,
    pack_events,
    parse_events,
)
from dvs_common.wire.keyframe import parse_keyframe
from dvs_common.wire.messages import Vector, pack_command, pack_estimate
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design import Design, design_from_scenario
from dvs_hinf_controller.design.design_warnings import RunningLoop, luminosity_warnings
from dvs_hinf_controller.design.live_certificate import LiveCertificate
from dvs_hinf_controller.design.start_up import start_up_report
from dvs_hinf_controller.running.backlog import Backlog
from dvs_hinf_controller.running.event_controller import PacketReport
from dvs_hinf_controller.running.look_ahead import ReadyAnswer
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_hinf_controller.running.reference_state import Synchrony
from dvs_hinf_controller.running.rehearsal import rehearse

# A keyframe is asked for again after 1, 2, 4 and 8 ticks, then every tenth.
_TICK_S = 0.05
_ASK_AT, _ASK_EVERY = (1, 2, 4, 8), 10
_STALE_S = 2.0
# Time without any known reference after which `unknown_references: stop` stops.
_UNKNOWN_S = 2.0
_UNKNOWN_REFERENCES = 4
# Of an estimate.
_BYTES_A_PIXEL = 24


class HinfControllerNode(ManagedNode):
    """Takes `events`; publishes `command`, and `estimate` while it has a subscriber.

    Verifies its counts by the sensor's `keyframe` and asks for one after a late start or a loss.

    Parameters
    ----------
    **node_arguments
        Further arguments of `rclpy.node.Node`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__(CONTROLLER, **node_arguments)

    # -- lifecycle and parameters ---------------------------------------------------------------

    def configure(self, scenario: Scenario) -> None:
        """Design the controller and report what it promises; see `ManagedNode.configure`."""
        self._scenario = scenario
        self._design = design_from_scenario(scenario)
        inputs = self._design.problem.model.input_count
        self._names = tuple(f'u{i + 1}' for i in range(inputs))
        self._copy = command_copy(scenario.controller.command_copy, inputs)
        self._command_publisher = self.advertise_token(
            JointState,
            topics.COMMAND,
            topics.handshake_qos(scenario.loop.mode, topics.LISTENER_DEPTH),
        )
        if self._copy is not None:
            kind = _copy_type(self._copy.topic)
            self._copy_publisher = self.advertise(kind, self._copy.topic, topics.stream_qos())
        pixels = self._design.problem.scene.pixel_count
        self._estimate_publisher = self.advertise_on_demand(
            JointState,
            topics.ESTIMATE,
            topics.stream_qos(topics.history_depth(_BYTES_A_PIXEL * pixels)),
        )
        self._request_publisher = self.advertise(
            Empty, topics.KEYFRAME_REQUEST, topics.stream_qos()
        )
        # Of all inputs, events alone must not be lost while this process does not run.
        depth = topics.history_depth(EVENT_DTYPE.itemsize * pixels)
        events = topics.handshake_qos(scenario.loop.mode, depth)
        self.subscribe(PointCloud2, topics.EVENTS, self._take, events)
        latched = topics.latched_qos(depth=1)
        self.subscribe(PointCloud2, topics.KEYFRAME, self._take_keyframe, latched)
        self.subscribe(Image, topics.ANCHOR, self._take_anchor, topics.stream_qos())
        self.every(_TICK_S, self._tick)
        for topic in (topics.EVENTS, topics.COMMAND):
            self.expect_one_publisher(topic)
        self._report_design()
        rehearse(event_controller(self._design, scenario))

    def _report_design(self) -> None:
        self._certificate = LiveCertificate(self._design, self._scenario.uncertainty.pixel_mask)
        beginning = event_controller(self._design, self._scenario)
        report = start_up_report(
            self._design.without_pixels(self._scenario.uncertainty.pixel_mask),
            RunningLoop.of_scenario(self._scenario),
            budget=beginning.read_budget(self._design.figures.delta_certified),
        )
        self.get_logger().info(report.text)
        of_luminosity = luminosity_warnings(
            self._design.problem, self._scenario.sensor.photoreceptor
        )
        for warning in (*report.warnings, *of_luminosity):
            self.get_logger().warning(warning)

    def activate(self) -> None:
        """Begin with what is known of the references before any event."""
        self._controller = event_controller(self._design, self._scenario)
        self._lost_events = self._resynchronisations = self._repeated = 0
        self._events = self._on_events = self._packets = 0
        self._event_rate, self._packet_rate = RateMeter(), RateMeter()
        self._threshold = self._controller.event_threshold
        self._unknown_said = False
        self._unknown_s = 0.0
        self._waited_ticks = 0
        self._stamp_ns = 0
        self._ready: ReadyAnswer | None = None
        has_past = self._scenario.loop.mode == 'lockstep'
        self._backlog = Backlog(time.time_ns()) if has_past else None

    def deactivate(self) -> None:
        """Leave a running plant with the input that holds the set-point."""
        if self._scenario.loop.mode == 'realtime' and self._packets:
            self._publish_command(self._stamp_ns, self._design.problem.equilibrium.feedforward)

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Design for another set-point or tolerance; see `ManagedNode.change`."""
        if scenario.sensor.event_threshold != self._scenario.sensor.event_threshold:
            raise ParameterError(
                'event_threshold',
                scenario.sensor.event_threshold,
                'changes on event_camera; the controller follows',
            )
        design = design_from_scenario(scenario)
        return lambda: self._adopt(scenario, design)

    def _adopt(self, scenario: Scenario, design: Design) -> None:
        self._scenario, self._design = scenario, design
        self._controller.redirect(design.problem, design.controller)
        self._report_design()

    # -- messages -------------------------------------------------------------------------------

    def _take(self, message: bytes) -> None:
        if self._backlog is None:
            self._answer(message)
        else:
            self._catch_up(message, self._backlog)

    def _catch_up(self, message: bytes, backlog: Backlog) -> None:
        """Take a packet that may be of the past."""
        packet, report = self._learn(message)
        self._packets += 1
        self._note(report, packet)
        self._stamp_ns = packet.stamp_ns
        now_s = time.monotonic()
        backlog.add(now_s)
        if backlog.is_of_now(self.published_ns, time.time_ns()) or backlog.is_over(now_s):
            self._answer_last()

    def _learn(self, message: bytes) -> tuple[EventPacket, PacketReport]:
        packet = parse_events(message)
        report = self._controller.take(packet)
        if report.restarted:
            self._command_publisher.forget()
        return packet, report

    def _answer_last(self) -> None:
        self._backlog = None
        self._publish_command(self._stamp_ns, self._controller.command)
        self._publish_estimate(self._stamp_ns)

    def _answer(self, message: bytes) -> None:
        ready, self._ready = self._ready, None
        report = None
        if ready is not None and message == ready.message and self._still_foresees(ready):
            packet = ready.packet
            self._send_command(ready.answer, ready.command)
            # An empty packet brings nothing but time.
            self._controller.take(packet)
        else:
            packet, report = self._learn(message)
            self._publish_command(packet.stamp_ns, self._controller.command)
        self._publish_estimate(packet.stamp_ns)
        self._packets += 1
        if report is not None:
            self._note(report, packet)
        before_ns, self._stamp_ns = self._stamp_ns, packet.stamp_ns
        self._get_ready(2 * packet.stamp_ns - before_ns)

    def _still_foresees(self, ready: ReadyAnswer) -> bool:
        """Whether no other message and no new parameter has changed the answer since."""
        return self._controller.foreseen(ready.packet) is ready.command

    def _get_ready(self, stamp_ns: int) -> None:
        """Make the answer to a next packet that is as long and empty, while there is time."""
        self._controller.look_ahead()
        packet = EventPacket(stamp_ns=stamp_ns, events=NO_EVENTS)
        command = self._controller.foreseen(packet)
        if command is not None:
            self._ready = ReadyAnswer(
                packet=packet,
                message=pack_events(packet),
                command=command,
                answer=self._packed(stamp_ns, command),
            )

    def _note(self, report: PacketReport, packet: EventPacket) -> None:
        self._repeated += report.repeated
        if len(packet.events) and not report.repeated:
            self._events += len(packet.events)
            self._on_events += int(np.count_nonzero(packet.events['polarity'] > 0))
        self._log_report(report, packet.stamp_ns)

    def _publish_command(self, stamp_ns: int, values: FloatArray) -> None:
        self._send_command(self._packed(stamp_ns, values), values)

    def _publish_estimate(self, stamp_ns: int) -> None:
        if self._estimate_publisher.wanted:
            self._estimate_publisher.publish(pack_estimate(stamp_ns, self._controller.estimate))

    def _packed(self, stamp_ns: int, values: FloatArray) -> bytes:
        return pack_command(Vector(stamp_ns=stamp_ns, names=self._names, values=values))

    def _send_command(self, message: bytes, values: FloatArray) -> None:
        self._command_publisher.publish(message)
        if self._copy is not None:
            self._copy_publisher.publish(self._copy.pack(values))

    def _take_keyframe(self, message: bytes) -> None:
        keyframe = parse_keyframe(message)
        self._log_report(self._controller.take_keyframe(keyframe), keyframe.stamp_ns)

    def _report_threshold(self) -> None:
        """Report another threshold as soon as it holds: a keyframe may announce it beforehand."""
        before, self._threshold = self._threshold, self._controller.event_threshold
        if before == self._threshold:
            return
        self.get_logger().warning(
            f'event_camera goes from h = {before:g} to {self._controller.event_threshold:g}; the '
            'estimator follows'
        )

    def _take_anchor(self, message: bytes) -> None:
        anchor = parse_anchor(message)
        self._log_report(self._controller.take_anchor(anchor), anchor.stamp_ns)

    def _log_report(self, report: PacketReport, stamp_ns: int) -> None:
        if report.restarted:
            self.get_logger().warning('stamps have started again: so do the estimator and K')
        if report.lost_events:
            self._lost_events += report.lost_events
            self.get_logger().error(
                f'{report.lost_events} events were lost before {as_seconds(stamp_ns):.6f} s '
                f'({self._lost_events} in all): asking for a keyframe'
            )
            self._ask_for_keyframe()
        if report.resynchronised_pixels:
            self._resynchronisations += 1
            self.get_logger().warning(
                f'resynchronised by a keyframe: {report.resynchronised_pixels} pixels corrected'
            )

        self._report_threshold()
        self._watch_sensor()

    def _watch_sensor(self) -> None:
        is_unknown = self._controller.synchrony is Synchrony.UNKNOWN
        if is_unknown and not self._unknown_said:
            self.get_logger().error(
                'references unknown: the sensor has started again, or was there before this '
                'controller, and no message has given them yet; waiting for a keyframe or '
                f'an anchor (unknown_references: {self._scenario.uncertainty.unknown_references})'
            )
            self._ask_for_keyframe()
        self._unknown_said = is_unknown

    def _ask_for_keyframe(self) -> None:
        if self._controller.references.needs_keyframe:
            self._request_publisher.publish(Empty())

    def _tick(self) -> None:
        if self._backlog is not None and self._backlog.is_over(time.monotonic()):
            self._answer_last()
        self._keep_asking()

    def _keep_asking(self) -> None:
        needs = self._controller.references.needs_keyframe
        self._waited_ticks = self._waited_ticks + 1 if needs else 0
        if self._waited_ticks in _ASK_AT or self._waited_ticks % _ASK_EVERY == 0:
            self._ask_for_keyframe()
        lacks_pixels = self._packets and self._controller.lacks_pixels
        self._unknown_s = self._unknown_s + _TICK_S if lacks_pixels else 0.0
        if (
            self._scenario.uncertainty.unknown_references == 'stop'
            and self._unknown_s > _UNKNOWN_S
        ):
            self.finish(_UNKNOWN_REFERENCES, 'references unknown (unknown_references: stop)')

    # -- health ---------------------------------------------------------------------------------

    def health(self) -> Health:
        """Rates, estimator and thresholds; see `ManagedNode.health`."""
        references = self._controller.references
        live = self._certificate.of(references.health.healthy)
        if live.error is not None:
            self.get_logger().error(
                f'no certificate of the pixels that are left: {live.error}',
                throttle_duration_sec=10.0,
            )
        budget = self._controller.read_budget(live.delta_certified)
        event_rate = self._event_rate.read(self._events)
        limiter = self._controller.limiter
        return Health(
            troubles=self._troubles(budget),
            values={
                'packets/s': f'{self._packet_rate.read(self._packets):.1f}',
                'Mev/s': f'{event_rate * 1e-6:.6f}',
                'share of ON': f'{self._on_events / max(self._events, 1):.3f}',
                'events': self._events,
                'events lost': self._lost_events,
                'packets received twice': self._repeated,
                'packets out of time': references.gate.refused,
                'resynchronisations': self._resynchronisations,
                'estimator': self._controller.synchrony.value,
                'anchors': references.anchors.used,
                'anchors unused': references.anchors.unused,
                'pixels contradicted by anchors': references.anchors.contradictions,
                'age of events [s]': f'{self.silence_s(topics.EVENTS):.3f}',
                'commands at command_limit': limiter.limited if limiter else 0,
                'commands at command_rate_limit': limiter.slowed if limiter else 0,
                **live.values(self._controller.event_threshold),
                **budget.figures,
            },
        )

    def _troubles(self, budget: Budget) -> list[Trouble]:
        troubles = []
        if self.silence_s(topics.EVENTS) > _STALE_S:
            troubles.append(Trouble(level=Level.STALE, message='no events arrive'))
        if self._controller.synchrony is Synchrony.LOST:
            troubles.append(Trouble(level=Level.ERROR, message='events lost'))
        if self._controller.synchrony is Synchrony.UNKNOWN:
            troubles.append(Trouble(level=Level.ERROR, message='references unknown'))
        limiter = self._controller.limiter
        if limiter is not None and limiter.is_limited:
            troubles.append(Trouble(level=Level.WARN, message='command at its limit'))
        if not budget.is_certified:
            troubles.append(Trouble(level=Level.WARN, message=str(budget)))
        return troubles


def _copy_type(topic: str) -> type:
    # A few commands are copied; all of geometry_msgs is loaded with these two.
    from geometry_msgs.msg import Twist, Wrench

    types: dict[str, type] = {
        topics.COMMAND_ARRAY: Float64MultiArray,
        topics.COMMAND_TWIST: Twist,
        topics.COMMAND_WRENCH: Wrench,
    }
    return types[topic]


def main() -> int:
    """Run the node until a signal."""
    return run_nodes([HinfControllerNode])
