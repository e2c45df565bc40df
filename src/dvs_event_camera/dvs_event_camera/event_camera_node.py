"""Node `event_camera`: luminosity samples in, polarity events out."""

from __future__ import annotations

import array
import importlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Empty, Int16MultiArray, MultiArrayDimension, MultiArrayLayout

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS, as_nanoseconds, as_seconds
from dvs_common.node.health import Health, Level, RateMeter, Trouble
from dvs_common.node.managed_node import ManagedNode
from dvs_common.node.spin import run_nodes
from dvs_common.scenario.parameters import CAMERA
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.anchor import pack_anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EVENT_DTYPE, EventPacket, pack_events
from dvs_common.wire.keyframe import pack_keyframe
from dvs_common.wire.messages import pack_image
from dvs_common.wire.stamp_gate import Passage, StampGate
from dvs_event_camera.event_camera import EventCamera, Exposure
from dvs_event_camera.expected_frame import ExpectedFrames
from dvs_event_camera.rehearsal import rehearse
from dvs_event_camera.streams.anchor_frames import AnchorFrames
from dvs_event_camera.streams.event_cloud import EventCloud, pack_cloud
from dvs_event_camera.streams.event_packet import pack_event_packet
from dvs_event_camera.streams.event_records import without_labels
from dvs_event_camera.streams.frame_map import FrameMap
from dvs_event_camera.streams.image_source import (
    LuminosityFrame,
    parse_compressed,
    parse_luminosity,
)
from dvs_event_camera.streams.net_polarity import net_polarity
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_event_camera.streams.renderer import EventRenderer

_STALE_S = 2.0
# A frame this much later than the last one is an outlier, or a clock that has stepped.
_REACH_NS = 5 * NANOSECONDS
_START_FAILED = 2
# Of a luminosity.
_BYTES_A_PIXEL = 8


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
        if self.is_given('pixel_grid'):
            rehearse(scenario)
        camera = scenario.camera
        self._map = FrameMap(
            PixelMap(region=camera.region, binning=camera.binning, masked=camera.masked_pixels)
        )
        stream = topics.stream_qos()
        self._events = self.advertise_token(PointCloud2, topics.EVENTS, self._events_qos())
        self._labels = (
            self.advertise(PointCloud2, topics.EVENTS_LABEL, stream)
            if scenario.camera.label_noise
            else None
        )
        self._keyframe = self.advertise(PointCloud2, topics.KEYFRAME, topics.latched_qos(depth=1))
        self._anchor = (
            self.advertise(Image, topics.ANCHOR, stream) if scenario.camera.frame_rate else None
        )
        self._polarity = self.advertise_on_demand(Int16MultiArray, topics.POLARITY, stream)
        self._image = self.advertise_on_demand(Image, topics.EVENT_IMAGE, stream)
        self._points = self.advertise_on_demand(PointCloud2, topics.EVENT_CLOUD, stream)
        self._packets = self._advertise_event_packets(stream)
        displays = (self._polarity, self._image, self._points, self._packets)
        self._displays = [publisher for publisher in displays if publisher is not None]
        # Whether a frame without events leads to an empty packet and nothing else.
        self._is_plain = (
            self._labels is None and self._anchor is None and self._map.changes_nothing
        )
        self._subscribe(self._frames_qos())
        for topic in (self._source, topics.EVENTS):
            self.expect_one_publisher(topic)
        self.subscribe(Empty, topics.KEYFRAME_REQUEST, self._answer_request, topics.stream_qos())

    def _events_qos(self) -> QoSProfile:
        """Deep in a loop; a camera without a loop has no bound on the size of its packets."""
        mode = self._scenario.loop.mode
        if not self.is_given('pixel_grid'):
            return topics.handshake_qos(mode)
        event_of_every_pixel = EVENT_DTYPE.itemsize * math.prod(self._scenario.pixels.pixel_grid)
        return topics.handshake_qos(mode, topics.history_depth(event_of_every_pixel))

    def _frames_qos(self) -> QoSProfile:
        pixels = math.prod(self._scenario.pixels.pixel_grid) if self.is_given('pixel_grid') else 1
        return topics.stream_qos(topics.backlog_depth(_BYTES_A_PIXEL * pixels))

    def _advertise_event_packets(self, qos: QoSProfile) -> Any:
        try:
            messages = importlib.import_module('event_camera_msgs.msg')
        except ImportError:
            return None
        return self.advertise_on_demand(messages.EventPacket, topics.EVENTS_PACKET, qos)

    def _subscribe(self, qos: QoSProfile) -> None:
        if self._scenario.camera.image_reliability == 'best_effort':
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if self._scenario.camera.compressed_input:
            self._source = f'{topics.LUMINOSITY}/compressed'
            self.subscribe(CompressedImage, self._source, self._take_compressed, qos)
        else:
            self._source = topics.LUMINOSITY
            self.subscribe(Image, self._source, self._take_image, qos)

    def activate(self) -> None:
        """Wait for the first sample."""
        self._camera = EventCamera.of_scenario(self._scenario)
        self._renderer: EventRenderer | None = None
        self._cloud: EventCloud | None = None
        self._next_image_ns = 0
        self._next_keyframe_ns: float = 0.0
        self._packet_number = 0
        self._frames = self._resent = self._restarts = 0
        self._invalid_reported = False
        self._event_rate, self._frame_rate = RateMeter(), RateMeter()
        self._restarts_reported = self._on_events = 0
        self._next_threshold: float | None = None
        self._gate = StampGate(_REACH_NS)
        self._frames_of_light = AnchorFrames.of_scenario(self._scenario)
        self._last_packets: tuple[EventPacket, ...] = ()
        self._expected = ExpectedFrames(self._gate)

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Change threshold or display; see `ManagedNode.change`."""
        pixels = self._camera.pixels
        if pixels is not None and self._differs(scenario):
            pixels.require_changeable_threshold()
        return lambda: self._adopt(scenario)

    def _differs(self, scenario: Scenario) -> bool:
        return bool(scenario.sensor.event_threshold != self._scenario.sensor.event_threshold)

    def _adopt(self, scenario: Scenario) -> None:
        self._expected.forget()
        if self._camera.pixels is None:
            self._camera = EventCamera.of_scenario(scenario)
        elif self._differs(scenario):
            self._next_threshold = scenario.sensor.event_threshold
            scenario = scenario.replace(event_threshold=self._scenario.sensor.event_threshold)
        self._scenario = scenario
        self._renderer = None

    # -- frames -----------------------------------------------------------------------------------

    def _take_image(self, message: bytes) -> None:
        silent = self._expected.take(message, self._camera)
        if silent is None:
            self._take(self._map.mapped(parse_luminosity(message)))
        else:
            self._events.publish(silent.answer)
            self._frames += 1
            self._last_packets = (silent.packet,)
            self._renderer = self._cloud = None
        if not self._is_plain or self._next_threshold is not None:
            return
        if not any(publisher.wanted for publisher in self._displays):
            self._expected.expect_after(message, before_ns=self._next_keyframe_ns)

    def _take_compressed(self, message: bytes) -> None:
        self._take(self._map.mapped(parse_compressed(message)))

    def _take(self, frame: LuminosityFrame) -> None:
        last_ns = self._gate.last_ns
        passage = self._gate.take(frame.stamp_ns)
        if passage is Passage.REFUSED:
            assert last_ns is not None
            raise MessageError(
                f'luminosity stamped {as_seconds(frame.stamp_ns - last_ns):+.6f} s from the last'
            )
        if passage is Passage.STEPPED:
            self._camera.restart('the clock of the luminosity has stepped')
        self._expose(frame)

    def _expose(self, frame: LuminosityFrame) -> None:
        waiting = self._camera.waiting_pixels
        try:
            exposure = self._camera.take(frame)
        except ParameterError as error:
            if self._camera.pixels is not None:
                raise MessageError(f'sensor cannot start again: {error}') from None
            if self._lacks_light(frame):
                raise MessageError(f'sensor waits for light to start: {error}') from None
            self.finish(_START_FAILED, str(error))
            return
        if exposure is None:
            self._answer_again()
            return
        self._frames += 1
        if exposure.restart_reason:
            self._restarts += 1
            self._events.forget()
            self.get_logger().warning(
                f'sensor started again, all references with it: {exposure.restart_reason}'
            )
        if exposure.started:
            self._report_waiting(frame)
        changed = self._change_threshold() or self._camera.waiting_pixels < waiting
        # A keyframe for the packet's events and those after it goes before it.
        self._publish_keyframe(frame.stamp_ns, due_now=exposure.started or changed)
        self._publish_anchor(frame)
        for packet in exposure.packets:
            self._publish(packet)
        self._last_packets = exposure.packets
        self._report_invalid()
        if self._image.wanted:
            self._draw(exposure, frame.stamp_ns)
        else:
            self._renderer = None
        self._show_points(exposure, frame.stamp_ns)

    def _lacks_light(self, frame: LuminosityFrame) -> bool:
        return self._scenario.sensor.photoreceptor == 'log' and not np.all(frame.pixels > 0)

    def _answer_again(self) -> None:
        """Answer a frame sent again with the same bytes: the first answer may have been lost."""
        self._resent += 1
        for packet in self._last_packets:
            self._events.publish(pack_events(without_labels(packet)))

    def _change_threshold(self) -> bool:
        """Fire at another threshold from the present frame on, if that is asked for."""
        if self._next_threshold is None:
            return False
        self._scenario = self._scenario.replace(event_threshold=self._next_threshold)
        self._next_threshold = None
        self._camera.change_event_threshold(self._scenario)
        return True

    def _publish_anchor(self, frame: LuminosityFrame) -> None:
        if self._anchor is None or self._frames_of_light is None:
            return
        anchor = self._frames_of_light.take(frame.stamp_ns, frame.pixels)
        if anchor is not None:
            height, width = self._camera.shape
            self._anchor.publish(pack_anchor(anchor, height=height, width=width))

    def _publish(self, packet: EventPacket) -> None:
        self._events.publish(pack_events(without_labels(packet)))
        if len(packet.events):
            self._on_events += int(np.count_nonzero(packet.events['polarity'] > 0))
        if self._labels is not None:
            self._labels.publish(pack_events(packet))
        if self._polarity.wanted:
            self._polarity.publish(_polarities(net_polarity(packet, self._camera.shape)))
        if self._packets is not None and self._packets.wanted:
            height, width = self._camera.shape
            message = pack_event_packet(
                packet, height=height, width=width, sequence=self._packet_number
            )
            self._packet_number += 1
            self._packets.publish(message)

    def _publish_keyframe(self, stamp_ns: int, *, due_now: bool) -> None:
        if not due_now and stamp_ns < self._next_keyframe_ns:
            return
        period_ns = as_nanoseconds(self._scenario.camera.keyframe_period)
        self._next_keyframe_ns = stamp_ns + period_ns if period_ns else math.inf
        self._send_keyframe()

    def _send_keyframe(self) -> None:
        height, width = self._camera.shape
        message = pack_keyframe(self._camera.keyframe(), height=height, width=width)
        self._keyframe.publish(message)

    def _answer_request(self, _: bytes) -> None:
        if self._camera.pixels is not None:
            self._send_keyframe()

    def _report_invalid(self) -> None:
        if self._camera.invalid_samples and not self._invalid_reported:
            self._invalid_reported = True
            self.get_logger().error(
                'luminosity without a logarithm (<= 0, NaN or infinite): such pixels hold their '
                'last value; counted on /diagnostics, logged once'
            )

    def _report_waiting(self, frame: LuminosityFrame) -> None:
        if waiting := self._camera.waiting_pixels:
            self.get_logger().warning(
                f'{waiting} of {frame.pixels.size} pixels have no light (<= 0, NaN or infinite) '
                'in the first frame: each of them starts with its first luminosity'
            )

    # -- for those who look -----------------------------------------------------------------------

    def _show_points(self, exposure: Exposure, stamp_ns: int) -> None:
        if not self._points.wanted:
            self._cloud = None
            return
        display = self._scenario.display
        if self._cloud is None or exposure.started:
            self._cloud = EventCloud(width=self._camera.shape[1], window_s=display.display_decay)
            self._next_cloud_ns = stamp_ns
        self._cloud.add(exposure.events, stamp_ns)
        if stamp_ns >= self._next_cloud_ns:
            self._next_cloud_ns = stamp_ns + round(NANOSECONDS / display.display_rate)
            self._points.publish(pack_cloud(stamp_ns, self._cloud.points(stamp_ns)))

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
                'frames out of time': self._gate.refused,
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


def _polarities(net: NDArray[np.int16]) -> Int16MultiArray:
    height, width = net.shape
    layout = MultiArrayLayout(
        dim=[
            MultiArrayDimension(label='y', size=height, stride=net.size),
            MultiArrayDimension(label='x', size=width, stride=width),
        ]
    )
    return Int16MultiArray(layout=layout, data=array.array('h', net.tobytes()))


def main() -> int:
    """Run the node until a signal."""
    return run_nodes([EventCameraNode])
