"""Node `event_camera`: luminosity samples in, polarity events out."""

from __future__ import annotations

import array
import importlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image, JointState, PointCloud2
from std_msgs.msg import Empty, Int16MultiArray, MultiArrayDimension, MultiArrayLayout

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS, as_nanoseconds
from dvs_common.node.health import Health, Level, RateMeter, Trouble
from dvs_common.node.managed_node import ManagedNode
from dvs_common.node.spin import run_nodes
from dvs_common.scenario.parameters import CAMERA
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.events import EVENT_DTYPE, EventPacket, pack_events
from dvs_common.wire.keyframe import Keyframe, pack_keyframe
from dvs_common.wire.messages import Vector, pack_command, pack_image
from dvs_event_camera.event_camera import EventCamera, Exposure
from dvs_event_camera.streams.event_packet import pack_event_packet
from dvs_event_camera.streams.event_records import without_labels
from dvs_event_camera.streams.image_source import (
    LuminosityFrame,
    parse_compressed,
    parse_luminosity,
)
from dvs_event_camera.streams.renderer import EventRenderer

_STALE_S = 2.0
_START_FAILED = 2
_INT16 = np.iinfo(np.int16)


class EventCameraNode(ManagedNode):
    """Takes `luminosity`; publishes `events` and what helps to look at them.

    Parameters
    ----------
    **node_arguments
        Further arguments of `rclpy.node.Node`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__(CAMERA, **node_arguments)

    def configure(self, scenario: Scenario) -> None:
        """Check the parameters and create the topics; see `ManagedNode.configure`."""
        self._scenario = scenario
        EventCamera.of_scenario(scenario)
        stream = topics.stream_qos()
        self._events = self.advertise_token(PointCloud2, topics.EVENTS, self._events_qos())
        self._labels = (
            self.advertise(PointCloud2, topics.EVENTS_LABEL, stream)
            if scenario.camera.label_noise
            else None
        )
        self._keyframe = self.advertise(Image, topics.KEYFRAME, topics.latched_qos(depth=1))
        self._polarity = self.advertise_on_demand(Int16MultiArray, topics.POLARITY, stream)
        self._image = self.advertise_on_demand(Image, topics.EVENT_IMAGE, stream)
        self._packets = self._advertise_event_packets(stream)
        self._threshold = self.advertise(JointState, topics.THRESHOLD, topics.latched_qos(depth=1))
        self._listen(stream)
        self.listen(Empty, topics.KEYFRAME_REQUEST, self._answer_request, topics.stream_qos())

    def _events_qos(self) -> QoSProfile:
        """Deep in a loop; a camera by itself can't tell how large its packets will be."""
        mode = self._scenario.loop.mode
        if not self.is_given('pixel_grid'):
            return topics.handshake_qos(mode)
        event_of_every_pixel = EVENT_DTYPE.itemsize * math.prod(self._scenario.pixels.pixel_grid)
        return topics.handshake_qos(mode, topics.history_depth(event_of_every_pixel))

    def _advertise_event_packets(self, qos: QoSProfile) -> Any:
        try:
            messages = importlib.import_module('event_camera_msgs.msg')
        except ImportError:
            return None
        return self.advertise_on_demand(messages.EventPacket, topics.EVENTS_PACKET, qos)

    def _listen(self, qos: QoSProfile) -> None:
        if self._scenario.camera.image_reliability == 'best_effort':
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if self._scenario.camera.compressed_input:
            self._source = f'{topics.LUMINOSITY}/compressed'
            self.listen(CompressedImage, self._source, self._take_compressed, qos)
        else:
            self._source = topics.LUMINOSITY
            self.listen(Image, self._source, self._take_image, qos)

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
        self._announced_threshold: float | None = None
        # log_b |q / q(0)| when the present counting began.
        self._moved = np.zeros(1)

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Change threshold or display; see `ManagedNode.change`."""
        pixels = self._camera.pixels
        if pixels is not None and self._differs(scenario):
            pixels.require_changeable_threshold()
        return lambda: self._adopt(scenario)

    def _differs(self, scenario: Scenario) -> bool:
        return bool(scenario.sensor.event_threshold != self._scenario.sensor.event_threshold)

    def _adopt(self, scenario: Scenario) -> None:
        if self._camera.pixels is None:
            self._camera = EventCamera.of_scenario(scenario)
        elif self._differs(scenario):
            self._next_threshold = scenario.sensor.event_threshold
            scenario = scenario.replace(event_threshold=self._scenario.sensor.event_threshold)
        self._scenario = scenario
        self._renderer = None

    # -- frames -----------------------------------------------------------------------------------

    def _take_image(self, message: bytes) -> None:
        self._take(parse_luminosity(message))

    def _take_compressed(self, message: bytes) -> None:
        self._take(parse_compressed(message))

    def _take(self, frame: LuminosityFrame) -> None:
        counts_anew = self._announced_threshold is not None and self._change_threshold(
            frame.stamp_ns
        )
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
        if exposure.started:
            self._moved = np.zeros(frame.pixels.size)
            self._announce_threshold(frame.stamp_ns, self._scenario.sensor.event_threshold)
            self._report_waiting(frame)
        if self._next_threshold is not None:
            self._announce_change(frame.stamp_ns, self._next_threshold)
        for packet in exposure.packets:
            self._publish(packet)
        self._publish_keyframe(frame.stamp_ns, due_now=exposure.started or counts_anew)
        self._report_invalid()
        if self._image.wanted:
            self._draw(exposure, frame.stamp_ns)
        else:
            self._renderer = None

    def _announce_threshold(self, after_ns: int, event_threshold: float) -> None:
        h = np.array([event_threshold])
        self._threshold.publish(
            pack_command(Vector(stamp_ns=after_ns, names=('event_threshold',), values=h))
        )

    def _change_threshold(self, stamp_ns: int) -> bool:
        """Fire at the threshold that was announced with the last frame, if this is another one."""
        pixels = self._camera.pixels
        if pixels is None or pixels.stamp_ns == stamp_ns:
            return False
        self._moved = self._moved + pixels.counts * self._scenario.sensor.event_threshold
        self._scenario = self._scenario.replace(event_threshold=self._announced_threshold)
        self._camera.change_event_threshold(self._scenario)
        self._announced_threshold = None
        return True

    def _announce_change(self, stamp_ns: int, event_threshold: float) -> None:
        """Say before the next frame at which threshold it will be seen."""
        self._announced_threshold, self._next_threshold = event_threshold, None
        self._announce_threshold(stamp_ns, event_threshold)

    def _publish(self, packet: EventPacket) -> None:
        self._events.publish(pack_events(without_labels(packet)))
        if len(packet.events):
            self._on_events += int(np.count_nonzero(packet.events['polarity'] > 0))
        if self._labels is not None:
            self._labels.publish(pack_events(packet))
        if self._polarity.wanted:
            self._polarity.publish(_net_polarity(packet, self._camera.shape))
        if self._packets is not None and self._packets.wanted:
            height, width = self._camera.shape
            message = pack_event_packet(
                packet, height=height, width=width, sequence=self._packet_number
            )
            self._packet_number += 1
            self._packets.publish(message)

    def _publish_keyframe(self, stamp_ns: int, *, due_now: bool) -> None:
        period_ns = as_nanoseconds(self._scenario.camera.keyframe_period)
        if not due_now and (not period_ns or stamp_ns < self._next_keyframe_ns):
            return
        self._next_keyframe_ns = stamp_ns + period_ns
        self._send_keyframe(stamp_ns)

    def _send_keyframe(self, stamp_ns: int) -> None:
        pixels = self._camera.pixels
        assert pixels is not None
        height, width = self._camera.shape
        keyframe = Keyframe(
            stamp_ns=stamp_ns,
            counts=pixels.counts.astype(np.int64),
            signs=pixels.signs,
            moved=self._moved,
        )
        signed = self._scenario.sensor.photoreceptor == 'signed_log'
        self._keyframe.publish(pack_keyframe(keyframe, height=height, width=width, signed=signed))

    def _answer_request(self, _: bytes) -> None:
        pixels = self._camera.pixels
        if pixels is not None and pixels.stamp_ns is not None:
            self._send_keyframe(pixels.stamp_ns)

    def _report_invalid(self) -> None:
        if self._camera.invalid_samples and not self._invalid_reported:
            self._invalid_reported = True
            self.get_logger().error(
                'luminosity without a logarithm (<= 0, NaN or infinite): such pixels hold their '
                'last value; counted in /diagnostics, not said again'
            )

    def _report_waiting(self, frame: LuminosityFrame) -> None:
        if waiting := self._camera.waiting_pixels:
            self.get_logger().warning(
                f'{waiting} of {frame.pixels.size} pixels have no light (<= 0, NaN or infinite) '
                'in the first frame: each of them starts with its first luminosity'
            )

    # -- for those who look -----------------------------------------------------------------------

    def _draw(self, exposure: Exposure, stamp_ns: int) -> None:
        s = self._scenario
        if self._renderer is None or exposure.started:
            self._renderer = EventRenderer(
                *self._camera.shape,
                style=s.display.display_style,
                palette=s.display.display_palette,
                decay_s=s.display.display_decay,
            )
            self._next_image_ns = stamp_ns
        self._renderer.add(exposure.events, stamp_ns)
        if stamp_ns >= self._next_image_ns:
            self._next_image_ns = stamp_ns + round(NANOSECONDS / s.display.display_rate)
            self._image.publish(pack_image(stamp_ns, self._renderer.draw(), 'bgr8'))

    def health(self) -> Health:
        """Rates and whatever disturbs the sensor; see `ManagedNode.health`."""
        events = self._camera.event_count
        rate = self._event_rate.read(events)
        return Health(
            troubles=self._troubles(),
            values={
                'Mev/s': f'{rate * 1e-6:.6f}',
                'frames/s': f'{self._frame_rate.read(self._frames):.1f}',
                'share of ON': f'{self._on_events / max(events, 1):.3f}',
                'events': events,
                'frames': self._frames,
                'frames sent again': self._resent,
                'restarts': self._restarts,
                'pixel samples without a logarithm': self._camera.invalid_samples,
                'pixels without light yet': self._camera.waiting_pixels,
                'size': '{} x {}'.format(*self._camera.shape),
                'age of luminosity [s]': f'{self.silence_s(self._source):.3f}',
                'h': self._scenario.sensor.event_threshold,
            },
        )

    def _troubles(self) -> list[Trouble]:
        troubles = []
        if self.silence_s(self._source) > _STALE_S:
            troubles.append(Trouble(level=Level.STALE, message='no luminosity arrives'))
        if self._camera.invalid_samples:
            troubles.append(Trouble(level=Level.ERROR, message='luminosity without a logarithm'))
        if self._restarts > self._restarts_reported:
            troubles.append(Trouble(level=Level.WARN, message='sensor started again'))
        self._restarts_reported = self._restarts
        return troubles


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
