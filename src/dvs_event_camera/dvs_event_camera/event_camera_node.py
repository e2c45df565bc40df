"""Node `event_camera`: luminosity samples in, polarity events out."""

from __future__ import annotations

import array
import importlib
import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Int16MultiArray, MultiArrayDimension, MultiArrayLayout

from dvs_event_camera.event_camera import EventCamera, Exposure
from dvs_event_camera.event_packet import pack_event_packet
from dvs_event_camera.event_records import without_labels
from dvs_event_camera.image_source import LuminosityFrame, luminosity_of, parse_compressed
from dvs_event_camera.renderer import EventRenderer
from dvs_interfaces import topics
from dvs_interfaces.errors import ParameterError
from dvs_interfaces.events import EventPacket, pack_events
from dvs_interfaces.managed_node import ManagedNode
from dvs_interfaces.messages import pack_image, parse_image
from dvs_interfaces.parameters import CAMERA
from dvs_interfaces.scenario import Scenario
from dvs_interfaces.spin import run_nodes

# How often the node looks whether anybody listens to its optional topics.
_LOOK_S = 0.1
_DIAGNOSTICS_S = 1.0
_START_FAILED = 2
_INT16 = np.iinfo(np.int16)


class EventCameraNode(ManagedNode):
    """Takes `luminosity`; publishes `events` and what helps to look at them."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__(CAMERA, **node_arguments)

    def configure(self, scenario: Scenario) -> None:
        """Check the parameters and create the topics; see `ManagedNode.configure`."""
        self._scenario = scenario
        EventCamera.of_scenario(scenario)
        stream = topics.stream_qos()
        handshake = topics.handshake_qos(scenario['mode'])
        self._events = self.advertise(PointCloud2, topics.EVENTS, handshake)
        self._labels = (
            self.advertise(PointCloud2, topics.EVENTS_LABEL, stream)
            if scenario['label_noise']
            else None
        )
        self._keyframe = self.advertise(Image, topics.KEYFRAME, topics.latched_qos(depth=1))
        self._polarity = self.advertise(Int16MultiArray, topics.POLARITY, stream)
        self._image = self.advertise(Image, topics.EVENT_IMAGE, stream)
        self._packets = self._advertise_event_packets(stream)
        self._threshold = self.advertise(JointState, topics.THRESHOLD, topics.latched_qos(depth=1))
        self._listen(stream)
        self.listen(Empty, topics.KEYFRAME_REQUEST, self._answer_request, topics.stream_qos())
        self.every(_LOOK_S, self._look)

    def _advertise_event_packets(self, qos: QoSProfile) -> Any:
        try:
            messages = importlib.import_module('event_camera_msgs.msg')
        except ImportError:
            return None
        return self.advertise(messages.EventPacket, topics.EVENTS_PACKET, qos)

    def _listen(self, qos: QoSProfile) -> None:
        if self._scenario['image_reliability'] == 'best_effort':
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if self._scenario['compressed_input']:
            topic = f'{topics.LUMINOSITY}/compressed'
            self.listen(CompressedImage, topic, self._take_compressed, qos)
        else:
            self.listen(Image, topics.LUMINOSITY, self._take_image, qos)

    def activate(self) -> None:
        """Wait for the first sample."""
        self._camera = EventCamera.of_scenario(self._scenario)
        self._renderer: EventRenderer | None = None
        self._next_image_ns = self._next_keyframe_ns = 0
        self._packet_number = 0
        self._frames = self._resent = self._restarts = 0
        self._invalid_reported = False
        self._event_rate, self._frame_rate = RateMeter(), RateMeter()
        self._restarts_reported = self._on_events = 0
        self._next_threshold: float | None = None
        self._polarity_wanted = self._image_wanted = self._packets_wanted = False
        self._look()

    # -- frames -----------------------------------------------------------------------------------

    def _take_image(self, message: bytes) -> None:
        self._take(luminosity_of(parse_image(message)))

    def _take_compressed(self, message: bytes) -> None:
        self._take(parse_compressed(message))

    def _take(self, frame: LuminosityFrame) -> None:
        try:
            exposure = self._camera.take(frame)
        except ParameterError as error:
            self.finish(_START_FAILED, str(error))
            return
        if exposure is None:
            self._resent += 1
            return
        self._frames += 1
        if exposure.restart_reason:
            self._restarts += 1
            self.get_logger().warning(
                f'sensor started again, all references with it: {exposure.restart_reason}'
            )
        for packet in exposure.packets:
            self._publish(packet)
        self._publish_keyframe(frame.stamp_ns, due_now=exposure.started)
        self._report_invalid()
        if self._image_wanted:
            self._draw(exposure, frame.stamp_ns)

    def _publish(self, packet: EventPacket) -> None:
        plain = EventPacket(stamp_ns=packet.stamp_ns, events=without_labels(packet.events))
        self._events.publish(pack_events(plain))
        if self._labels is not None:
            self._labels.publish(pack_events(packet))
        if self._polarity_wanted:
            self._polarity.publish(_net_polarity(packet, self._camera.shape))
        if self._packets_wanted:
            height, width = self._camera.shape
            message = pack_event_packet(
                packet, height=height, width=width, sequence=self._packet_number
            )
            self._packet_number += 1
            self._packets.publish(message)

    def _publish_keyframe(self, stamp_ns: int, *, due_now: bool) -> None:
        period_ns = round(self._scenario['keyframe_period'] * 1e9)
        if not due_now and (not period_ns or stamp_ns < self._next_keyframe_ns):
            return
        self._next_keyframe_ns = stamp_ns + period_ns
        pixels = self._camera.pixels
        assert pixels is not None
        counts = pixels.counts.reshape(self._camera.shape)
        self._keyframe.publish(pack_image(stamp_ns, counts, '32SC1'))

    def _report_invalid(self) -> None:
        if self._camera.invalid_samples and not self._invalid_reported:
            self._invalid_reported = True
            self.get_logger().error(
                'luminosity without a logarithm (<= 0, NaN or infinite): such pixels hold their '
                'last value; counted in /diagnostics, not said again'
            )

    # -- for those who look -----------------------------------------------------------------------

    def _look(self) -> None:
        self._polarity_wanted = self._polarity.get_subscription_count() > 0
        self._image_wanted = self._image.get_subscription_count() > 0
        self._packets_wanted = (
            self._packets is not None and self._packets.get_subscription_count() > 0
        )
        if not self._image_wanted:
            self._renderer = None

    def _draw(self, exposure: Exposure, stamp_ns: int) -> None:
        s = self._scenario
        if self._renderer is None or exposure.started:
            self._renderer = EventRenderer(
                *self._camera.shape,
                style=s['display_style'],
                palette=s['display_palette'],
                decay_s=s['display_decay'],
            )
            self._next_image_ns = stamp_ns
        self._renderer.add(exposure.events, stamp_ns)
        if stamp_ns >= self._next_image_ns:
            self._next_image_ns = stamp_ns + round(1e9 / s['display_rate'])
            self._image.publish(pack_image(stamp_ns, self._renderer.draw(), 'bgr8'))

    def _publish_diagnostics(self) -> None:
        now, events = time.monotonic(), self._camera.event_count
        before, events_before, restarts_before = self._reported
        self._reported = (now, events, self._restarts)
        rate = (events - events_before) / max(now - before, 1e-9)
        trouble = []
        if self._restarts > restarts_before:
            trouble.append('sensor started again')
        if self._camera.invalid_samples:
            trouble.append('luminosity without a logarithm')
        if self.rejected_messages:
            trouble.append('messages refused')
        values = {
            'events': events,
            'events per wall-clock second': f'{rate:.0f}',
            'frames': self._frames,
            'frames sent again': self._resent,
            'restarts': self._restarts,
            'pixel samples without a logarithm': self._camera.invalid_samples,
            'messages refused': self.rejected_messages,
            'size': '{} x {}'.format(*self._camera.shape),
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if trouble else DiagnosticStatus.OK,
            name=f'{self.get_fully_qualified_name()[1:]}: events',
            message='; '.join(trouble) or ('waiting for luminosity', 'ok')[self._frames > 0],
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def _net_polarity(packet: EventPacket, shape: tuple[int, int]) -> Int16MultiArray:
    height, width = shape
    events = packet.events
    pixel = events['y'].astype(np.int64) * width + events['x']
    net = np.bincount(pixel, weights=events['polarity'], minlength=height * width)
    data = array.array('h')
    data.frombytes(np.clip(net, _INT16.min, _INT16.max).astype('<i2').tobytes())
    layout = MultiArrayLayout(
        dim=[
            MultiArrayDimension(label='y', size=height, stride=height * width),
            MultiArrayDimension(label='x', size=width, stride=width),
        ]
    )
    return Int16MultiArray(layout=layout, data=data)


def main() -> int:
    """Run the node until a signal."""
    return run_nodes([EventCameraNode])
