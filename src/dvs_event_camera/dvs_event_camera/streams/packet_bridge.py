"""A driver's EventPacket messages as the loop's `events`: the core of the node of that name."""

from __future__ import annotations

from dataclasses import replace

from dvs_common.wire.events import EventPacket
from dvs_event_camera.streams.event_packet import DriverPacket, parse_event_packet
from dvs_event_camera.streams.packet_decoder import PacketDecoder
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_event_camera.streams.sensor_clock import SensorClock
from dvs_event_camera.streams.wire_stream import WireStream


class PacketBridge:
    """Decodes, crops, dates and numbers the events of one driver.

    Parameters
    ----------
    pixel_map
        Which pixels of the sensor belong to the loop.

    Attributes
    ----------
    notice
        What is to be logged about the last message; empty if nothing.
    """

    def __init__(self, pixel_map: PixelMap) -> None:
        self._pixel_map = pixel_map
        self._decoder = PacketDecoder()
        self._clock = SensorClock()
        self._stream = WireStream()
        self._next_sequence: int | None = None
        self.notice = ''

    def take(self, message: bytes) -> list[EventPacket]:
        """Packets of the next message.

        A driver keeps no sums of the polarities that came before: a gap in its sequence
        numbers becomes a gap in the running index, so that consumers see the loss.

        Parameters
        ----------
        message
            CDR bytes of an EventPacket.

        Raises
        ------
        MessageError
            If it can't be decoded.
        ParameterError
            If the pixel map does not fit the sensor.
        """
        self.notice = ''
        packet = parse_event_packet(message)
        events = self._decoder.decode(packet)
        self._watch_sequence(packet)
        dates = self._clock.dates(events.t, packet.stamp_ns)
        end_ns = int(dates[-1]) if dates.size else packet.stamp_ns
        kept = self._pixel_map.mapped(replace(events, t=dates), packet.width, packet.height)
        return self._stream.packets(kept, end_ns)

    def _watch_sequence(self, packet: DriverPacket) -> None:
        expected, self._next_sequence = self._next_sequence, packet.sequence + 1
        if expected is None or packet.sequence == expected:
            return
        self._stream.note_loss()
        missing = packet.sequence - expected
        self.notice = (
            f'{missing} packets lost before number {packet.sequence}'
            if missing > 0
            else f'packet numbers go back to {packet.sequence}: the driver started again'
        )
