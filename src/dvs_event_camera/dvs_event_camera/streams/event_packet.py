"""`event_camera_msgs/EventPacket` as CDR bytes: read in any encoding, written in `mono`.

The message of the drivers and tools of github.com/ros-event-camera. An event in `mono` is a
little-endian 64-bit word: polarity in bit 63, y in bits 48 to 62, x in bits 32 to 47 and the
nanoseconds since `time_base` in bits 0 to 31. `packet_decoder` decodes this and the others.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.cdr import CdrWriter, MessageError, require_plain, stamp_ns_of
from dvs_common.wire.events import FRAME_ID, EventPacket

MESSAGE_TYPE = 'event_camera_msgs/msg/EventPacket'
# Text of the message definition, for bags.
DEFINITION = (
    'std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n'
    'string encoding\nbool is_bigendian\nuint8[] events\n'
)
_ENCODING = 'mono'
# Runs of fields between the texts of a message; what follows each is the size of the text.
_STAMP, _SHAPE, _COUNTS = struct.Struct('<iII'), struct.Struct('<II'), struct.Struct('<QQI')
_SIZE = struct.Struct('<I')


def encode_mono(packet: EventPacket) -> tuple[int, NDArray[np.uint64]]:
    """Time base (the first event's stamp) and words of a packet.

    The sign of a reference has no place in this encoding and is lost.

    Parameters
    ----------
    packet
        Events, sorted by time.

    Returns
    -------
    time_base, words
        Nanoseconds, and one word an event, shape (E,).
    """
    events = packet.events
    if not len(events):
        return packet.stamp_ns, np.empty(0, '<u8')
    octets = np.ascontiguousarray(events).view('<u8').reshape(-1, 2)
    where, rest = octets[:, 0], octets[:, 1]
    x, y = where & 0xFFFF, (where >> 16) & 0x7FFF
    since = events['t'].astype(np.int64)
    on = (rest >> 39 & 1) ^ 1  # the sign bit of the polarity byte
    elapsed = (since - since[0]).astype(np.uint64)
    words = on << 63 | y << 48 | x << 32 | elapsed
    return packet.stamp_ns + int(since[0]), words.astype('<u8')


def pack_event_packet(packet: EventPacket, *, height: int, width: int, sequence: int) -> bytes:
    """Serialized EventPacket; header stamp and `time_base` are the first event's time.

    Parameters
    ----------
    packet
        Events, sorted by time.
    height
        Rows of the pixel array.
    width
        Columns of the pixel array.
    sequence
        Running number of the message.
    """
    time_base, words = encode_mono(packet)
    writer = CdrWriter()
    writer.stamp(time_base)
    writer.text(FRAME_ID)
    writer.u32(height)
    writer.u32(width)
    writer.u64(sequence)
    writer.u64(time_base % 2**64)
    writer.text(_ENCODING)
    writer.u8(0)
    writer.octets(words.tobytes())
    return writer.finish()


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverPacket:
    """An EventPacket message, its events still encoded.

    Parameters
    ----------
    stamp_ns
        Header stamp, ROS time, ns.
    height
        Rows of the sensor.
    width
        Columns of the sensor.
    sequence
        Running number of the message.
    time_base
        Sensor time from which the events count, ns; 0 for `evt3`.
    encoding
        How the events are encoded.
    big_endian
        Byte order of the events.
    data
        Encoded events.
    """

    stamp_ns: int
    height: int
    width: int
    sequence: int
    time_base: int
    encoding: str
    big_endian: bool
    data: memoryview


def parse_event_packet(message: bytes) -> DriverPacket:
    """Fields of a serialized EventPacket.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short or no plain CDR.
    """
    require_plain(message[:2])
    # By hand and not field by field: a driver's packet may hold a few hundred events only.
    try:
        seconds, nanoseconds, size = _STAMP.unpack_from(message, 4)
        place = _aligned(16 + size, 4)
        height, width = _SHAPE.unpack_from(message, place)
        place = _aligned(place + 8, 8)
        sequence, time_base, size = _COUNTS.unpack_from(message, place)
        place += 20
        text = bytes(message[place : place + max(size - 1, 0)])
        big_endian = bool(message[place + size])
        place = _aligned(place + size + 1, 4)
        (size,) = _SIZE.unpack_from(message, place)
    except (struct.error, IndexError):
        raise MessageError('message ends too early') from None
    data = memoryview(message)[place + 4 : place + 4 + size]
    if len(data) != size:
        raise MessageError(f'message ends {size - len(data)} bytes too early')
    return DriverPacket(
        stamp_ns=stamp_ns_of(seconds, nanoseconds),
        height=height,
        width=width,
        sequence=sequence,
        time_base=_signed(time_base),
        encoding=text.decode('utf-8', 'replace'),
        big_endian=big_endian,
        data=data,
    )


def _aligned(place: int, size: int) -> int:
    """Where a field of some size begins; the encapsulation of 4 bytes is not counted."""
    return place + -(place - 4) % size


def _signed(value: int) -> int:
    return value - 2**64 if value >= 2**63 else value
