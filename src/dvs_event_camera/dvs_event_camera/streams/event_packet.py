"""`event_camera_msgs/EventPacket` with the `mono` encoding, as CDR bytes, both ways.

The message of the drivers and tools of github.com/ros-event-camera. An event is a little-endian
64-bit word: polarity in bit 63, y in bits 48 to 62, x in bits 32 to 47 and the nanoseconds since
`time_base` in bits 0 to 31.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_common.wire.events import (
    FRAME_ID,
    LONGEST_INTERVAL_NS,
    EventPacket,
    make_events,
)

MESSAGE_TYPE = 'event_camera_msgs/msg/EventPacket'
_ENCODING = 'mono'


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


def decode_mono(
    words: NDArray[np.uint64], *, time_base: int, width: int, first_index: int
) -> EventPacket:
    """Event packet of `mono` words, put in order; its stamp is that of the last event.

    Parameters
    ----------
    words
        One word an event, shape (E,).
    time_base
        Time from which the words count, ns; also the packet's stamp if there are no events.
    width
        Columns of the pixel array.
    first_index
        Running number of the first event.

    Raises
    ------
    MessageError
        If an event lies outside the width, or the packet spans more than INT32 nanoseconds.
    """
    words = words.astype(np.uint64)
    x = (words >> 32 & 0xFFFF).astype(np.int64)
    y = (words >> 48 & 0x7FFF).astype(np.int64)
    times = (words & 0xFFFFFFFF).astype(np.int64) + time_base
    if x.size and int(x.max()) >= width:
        raise MessageError(f'event at x = {x.max()} lies outside the width of {width} pixels')
    polarity = np.where(words >> 63 != 0, 1, -1).astype(np.int8)
    pixel = y * width + x
    order = np.lexsort((polarity, pixel, times))
    times = times[order]
    if times.size and int(times[-1] - times[0]) > LONGEST_INTERVAL_NS:
        raise MessageError(
            f'packet spans {as_seconds(times[-1] - times[0]):.3f} s, at most 2.1 s fit'
        )
    stamp_ns = int(times[-1]) if times.size else time_base
    events = make_events(
        times_ns=times,
        pixels=pixel[order],
        polarities=polarity[order],
        signs=np.ones(times.size, np.int8),
        width=width,
        stamp_ns=stamp_ns,
        first_index=first_index,
    )
    return EventPacket(stamp_ns=stamp_ns, events=events)


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


def parse_event_packet(message: bytes, *, first_index: int = 0) -> tuple[EventPacket, int]:
    """Events of a serialized EventPacket, in the time of its header stamp, and its number.

    A driver's `time_base` counts from an epoch of its own; header stamp plus the time since
    `time_base` is the driver's best estimate of ROS time, so that is what events are stamped with.

    Parameters
    ----------
    message
        CDR bytes.
    first_index
        Running number of the first event.

    Returns
    -------
    packet, sequence
        Events, and the running number of the message.

    Raises
    ------
    MessageError
        If the encoding is not `mono`, little-endian, or the message is cut short.
    """
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    reader.text()
    reader.u32()
    width = reader.u32()
    sequence = reader.u64()
    reader.u64()
    encoding, big_endian, data = reader.text(), reader.u8(), reader.octets()
    if encoding != _ENCODING or big_endian:
        raise MessageError(
            f'EventPacket encoding {encoding!r} must be mono, little-endian; the converter of '
            'event_camera_tools makes mono of others'
        )
    if len(data) % 8:
        raise MessageError(f'{len(data)} bytes of mono events are not a multiple of 8')
    packet = decode_mono(
        np.frombuffer(data, '<u8'), time_base=stamp_ns, width=width, first_index=first_index
    )
    return packet, sequence
