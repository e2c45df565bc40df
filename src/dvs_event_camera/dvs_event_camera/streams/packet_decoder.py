"""Events of `event_camera_msgs/EventPacket` in the encodings that drivers publish.

`evt3` is what metavision_driver sends, `libcaer_cmp` or `libcaer` libcaer_driver, `mono` older
ones. The times are the sensor's: for `evt3` since the sensor's start, for the others since the
epoch, as the driver fixed it when it started.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.wire.cdr import MessageError
from dvs_event_camera.streams.compiled import compiled
from dvs_event_camera.streams.event_packet import DriverPacket
from dvs_event_camera.streams.sensor_events import SensorEvents, Triggers, joined, no_events

ENCODINGS = ('evt3', 'libcaer_cmp', 'libcaer', 'mono', 'trigger')
# An event of libcaer counts microseconds in 31 bits.
_CAER_OVERFLOW_NS = 2**31 * 1000
_EVT3_TRIGGER = 0xA
# An OFF event in column 0 changes nothing of a decoder's state, and has its time.
_EVT3_PROBE = np.array([0x2000], '<u2')


class PacketDecoder:
    """Decodes the packets of one driver, in the order in which it sent them."""

    def __init__(self) -> None:
        self._evt3: Evt3Decoder | None = None
        self._size = (0, 0)

    def decode(self, packet: DriverPacket) -> SensorEvents:
        """Events of a packet, in the order in which it has them.

        Parameters
        ----------
        packet
            Next packet of the driver.

        Raises
        ------
        MessageError
            If the encoding is an unknown one, or the data are none of it.
        """
        if packet.encoding == 'evt3':
            return self._evt3_of(packet).decode(packet.data)
        decode = {
            'libcaer_cmp': _decode_caer_cmp,
            'libcaer': _decode_caer,
            'mono': _decode_mono,
            'trigger': _decode_trigger,
        }.get(packet.encoding)
        if decode is None or packet.big_endian:
            order = 'big' if packet.big_endian else 'little'
            raise MessageError(
                f'EventPacket encoding {packet.encoding!r}, {order}-endian, must be one of '
                f'{", ".join(ENCODINGS)}, little-endian'
            )
        return decode(packet)

    def _evt3_of(self, packet: DriverPacket) -> Evt3Decoder:
        size = (packet.width, packet.height)
        if self._evt3 is None or self._size != size:
            self._evt3 = Evt3Decoder(*size)
            self._size = size
        return self._evt3


class Evt3Decoder:
    """Decodes a stream of EVT 3.0 words in pieces, by the PyPI package evt3.

    Parameters
    ----------
    width
        Columns of the sensor; events beyond are left out, as the reference decoder does.
    height
        Rows of the sensor.

    Raises
    ------
    ParameterError
        If the package is not installed.
    """

    def __init__(self, width: int, height: int) -> None:
        try:
            evt3 = importlib.import_module('evt3')
        except ImportError:
            raise ParameterError('encoding', 'evt3', 'needs the Python package evt3') from None
        self._size = (width, height)
        self._kernels = kernels()
        self._decoder = evt3.Decoder(sensor_width=width, sensor_height=height)

    def decode(self, data: bytes | memoryview) -> SensorEvents:
        """Events and triggers of a whole number of words.

        Parameters
        ----------
        data
            Little-endian 16-bit words.

        Raises
        ------
        MessageError
            If they are not whole, or the package refuses them.
        """
        words = words_of(data, '<u2', 'evt3')
        if not self._kernels.count_evt3_triggers(words):
            return self._within(self._feed(data))
        at = np.flatnonzero(words >> 12 == _EVT3_TRIGGER)
        return joined(
            [
                part
                for piece in np.split(words, at + 1)
                for part in (
                    self._within(self._feed(piece.tobytes())),
                    self._trigger_after(piece),
                )
            ]
        )

    def _within(self, events: Any) -> SensorEvents:
        """Events of the sensor's pixels: the package gives out the others as well."""
        x, y, (width, height) = events.x, events.y, self._size
        t = np.empty(len(x), np.int64)
        outside = self._kernels.date_evt3(events.t, x, y, width, height, t)
        found = SensorEvents(t=t, x=x, y=y, p=events.p)
        return found.take((x < width) & (y < height)) if outside else found

    def _trigger_after(self, piece: NDArray[np.uint16]) -> SensorEvents:
        """Edge that the last word of a piece is, if it is one, dated by an event of our own."""
        if not piece.size or piece[-1] >> 12 != _EVT3_TRIGGER:
            return no_events()
        word = int(piece[-1])
        now = self._feed(_EVT3_PROBE.tobytes()).t.view(np.int64) * 1000
        source = np.full(now.size, word >> 8 & 0xF, np.uint8)
        rising = np.full(now.size, word & 1, np.uint8)
        return no_events(Triggers(t=now, source=source, rising=rising))

    def _feed(self, words: bytes | memoryview) -> Any:
        try:
            return self._decoder.feed(bytes(words))
        except ValueError as error:
            raise MessageError(f'no EVT 3.0 words: {error}') from None


def kernels() -> Any:
    """Module `codecs_numba`."""
    return compiled('dvs_event_camera.streams.codecs_numba')


def words_of(data: bytes | memoryview, kind: str, encoding: str) -> NDArray[Any]:
    """Words of a packet, not copied.

    Parameters
    ----------
    data
        Bytes.
    kind
        Type of a word.
    encoding
        What the bytes are in.

    Raises
    ------
    MessageError
        If the bytes are no whole number of words.
    """
    size = np.dtype(kind).itemsize
    if len(data) % size:
        raise MessageError(f'{len(data)} bytes of {encoding} events are not a multiple of {size}')
    return np.frombuffer(data, kind)


def _decode_caer_cmp(packet: DriverPacket) -> SensorEvents:
    codecs = kernels()
    words = words_of(packet.data, '<u2', packet.encoding)
    count = codecs.count_caer(words)
    t = np.empty(count, np.int64)
    x, y, p = np.empty(count, np.uint16), np.empty(count, np.uint16), np.empty(count, np.uint8)
    kept = codecs.decode_caer(words, packet.time_base, packet.width, packet.height, t, x, y, p)
    return SensorEvents(t=t[:kept], x=x[:kept], y=y[:kept], p=p[:kept])


def _decode_caer(packet: DriverPacket) -> SensorEvents:
    words = words_of(packet.data, '<u8', packet.encoding)
    halves = words.view('<u4').reshape(-1, 2)
    address, since = halves[:, 0], halves[:, 1].view('<i4').astype(np.int64)
    t = since * 1000 + packet.time_base
    if np.any(since[1:] < since[:-1]):
        t[1:] += np.cumsum(since[1:] < since[:-1]) * _CAER_OVERFLOW_NS
    return SensorEvents(
        t=t,
        x=(address >> 17).astype(np.uint16),
        y=(address >> 2 & 0x7FFF).astype(np.uint16),
        p=(address >> 1 & 1).astype(np.uint8),
    )


def _mono_times(packet: DriverPacket, words: NDArray[np.uint64]) -> NDArray[np.int64]:
    return (words & 0xFFFFFFFF).astype(np.int64) + packet.time_base


def _decode_mono(packet: DriverPacket) -> SensorEvents:
    words = words_of(packet.data, '<u8', packet.encoding)
    return SensorEvents(
        t=_mono_times(packet, words),
        x=(words >> 32).astype(np.uint16),
        y=(words >> 48 & 0x7FFF).astype(np.uint16),
        p=(words >> 63).astype(np.uint8),
    )


def _decode_trigger(packet: DriverPacket) -> SensorEvents:
    words = words_of(packet.data, '<u8', packet.encoding)
    triggers = Triggers(
        t=_mono_times(packet, words),
        source=(words >> 48 & 0xFF).astype(np.uint8),
        rising=(words >> 63).astype(np.uint8),
    )
    return no_events(triggers)
