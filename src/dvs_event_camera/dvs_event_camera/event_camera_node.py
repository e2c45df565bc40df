"""Node `event_camera`: luminosity samples in, polarity events out."""

from __future__ import annotations

from sensor_msgs.msg import Image, PointCloud2

from dvs_event_camera.photoreceptor import LogPhotoreceptor, SignedLogPhotoreceptor
from dvs_event_camera.pixel_array import PixelArray
from dvs_interfaces import topics
from dvs_interfaces.errors import ParameterError
from dvs_interfaces.events import EventPacket, make_events, pack_events
from dvs_interfaces.managed_node import ManagedNode
from dvs_interfaces.messages import luminosity_image, parse_image
from dvs_interfaces.parameters import CAMERA
from dvs_interfaces.scenario import Scenario
from dvs_interfaces.spin import run_nodes


class EventCameraNode(ManagedNode):
    """Takes `luminosity`; publishes `events`."""

    def __init__(self, **node_arguments: object) -> None:
        super().__init__(CAMERA, **node_arguments)

    def configure(self, scenario: Scenario) -> None:
        """Create the topics; see `ManagedNode.configure`."""
        self._scenario = scenario
        qos = topics.handshake_qos(scenario['mode'])
        self._events_publisher = self.advertise(PointCloud2, topics.EVENTS, qos)
        self.listen(Image, topics.LUMINOSITY, self._take, topics.stream_qos())

    def activate(self) -> None:
        """Wait for the first sample."""
        self._pixels: PixelArray | None = None
        self._index = 0

    def _start(self, luminosity) -> PixelArray:
        s = self._scenario
        return PixelArray(
            event_threshold=s['event_threshold'],
            log_base=s['log_base'],
            photoreceptor=SignedLogPhotoreceptor(band=s['dead_band'])
            if s['photoreceptor'] == 'signed_log'
            else LogPhotoreceptor(),
            bounds=s.reference_bounds(luminosity),
            initial_reference=s['initial_reference'],
            seed=s['seed'],
        )

    def _take(self, message: bytes) -> None:
        frame = parse_image(message)
        y = luminosity_image(frame)
        if self._pixels is None:
            try:
                pixels = self._start(y)
                pixels.update(frame.stamp_ns, y)
            except ParameterError as error:
                self.finish(2, str(error))
                return
            self._pixels = pixels
            events = make_events_of(None, frame, 0)
        else:
            if frame.stamp_ns == self._pixels.stamp_ns:
                return
            fired = self._pixels.update(frame.stamp_ns, y)
            events = make_events_of(fired, frame, self._index)
            self._index += len(fired)
        self._events_publisher.publish(
            pack_events(EventPacket(stamp_ns=frame.stamp_ns, events=events))
        )


def make_events_of(fired, frame, index):

    from dvs_event_camera.pixel_events import PixelEvents

    fired = fired or PixelEvents.empty()
    return make_events(
        times_ns=fired.t,
        pixels=fired.pixel,
        polarities=fired.polarity,
        signs=fired.sign,
        width=frame.width,
        stamp_ns=frame.stamp_ns,
        first_index=index,
    )


def main() -> int:
    """Run the node until a signal."""
    return run_nodes([EventCameraNode])
