"""`dvs_msgs/EventArray` of rpg_dvs_ros and its kin, as CDR bytes of ROS 2 or bytes of ROS 1."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_event_camera.streams.sensor_events import SensorEvents

EVENT_ARRAY = 'dvs_msgs/msg/EventArray'
_NAMES = ['x', 'y', 'sec', 'nanosec', 'on']


def _event(offsets: list[int], size: int) -> np.dtype[np.void]:
    formats = ['<u2', '<u2', '<u4', '<u4', 'u1']
    return np.dtype({'names': _NAMES, 'formats': formats, 'offsets': offsets, 'itemsize': size})


# Packed in ROS 1. In CDR seconds are aligned to four bytes and columns to two: the first event
# begins at a multiple of four, every other one two bytes before a multiple of sixteen.
_ROS1_EVENT = _event([0, 2, 4, 8, 12], 13)
_FIRST_EVENT = _event([0, 2, 4, 8, 12], 14)
_OTHER_EVENT = _event([0, 2, 6, 10, 14], 16)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventArray:
    """A message of events that carry their own stamps.

    Parameters
    ----------
    stamp_ns
        Header stamp, ns.
    height
        Rows of the sensor.
    width
        Columns of the sensor.
    events
        Its events; times are their stamps.
    """

    stamp_ns: int
    height: int
    width: int
    events: SensorEvents


def parse_event_array(message: bytes) -> EventArray:
    """Events of a serialized EventArray.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short.
    """
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    reader.text()
    height, width, count = reader.u32(), reader.u32(), reader.u32()
    start = reader.position
    size = count * _OTHER_EVENT.itemsize - 2 if count else 0
    if start + size - 1 > len(message):
        raise MessageError(f'{count} events do not fit {len(message) - start} bytes')
    octets = bytes(message[start : start + size]).ljust(size, b'\0')
    records = np.empty(count, _ROS1_EVENT)
    for part, dtype, offset in _parts(count):
        records[part] = np.frombuffer(octets, dtype, len(records[part]), offset)
    seconds = records['sec'].astype(np.int64)
    return EventArray(
        stamp_ns=stamp_ns,
        height=height,
        width=width,
        events=SensorEvents(
            t=seconds * NANOSECONDS + records['nanosec'],
            x=records['x'].copy(),
            y=records['y'].copy(),
            p=(records['on'] != 0).astype(np.uint8),
        ),
    )


def event_array_from_ros1(message: bytes) -> bytes:
    """CDR bytes of an EventArray of ROS 1.

    Parameters
    ----------
    message
        Bytes as ROS 1 serializes it.

    Raises
    ------
    MessageError
        If the message is cut short.
    """
    try:
        _, seconds, nanoseconds, size = struct.unpack_from('<4I', message)
        frame = message[16 : 16 + size].decode('utf-8', 'replace')
        height, width, count = struct.unpack_from('<3I', message, 16 + size)
        packed = np.frombuffer(message, _ROS1_EVENT, count, 28 + size)
    except (struct.error, ValueError):
        raise MessageError(f'EventArray of {len(message)} bytes is cut short') from None
    writer = CdrWriter()
    writer.stamp(seconds * NANOSECONDS + nanoseconds)
    writer.text(frame)
    for number in (height, width, count):
        writer.u32(number)
    octets = bytearray(count * _OTHER_EVENT.itemsize - 2 if count else 0)
    for part, dtype, offset in _parts(count):
        records = np.frombuffer(octets, dtype, len(packed[part]), offset)
        for name in _NAMES:
            records[name] = packed[part][name]
    return writer.finish() + octets


def _parts(count: int) -> list[tuple[slice, np.dtype[np.void], int]]:
    """Where events stand in CDR: which of them, how laid out, from which byte on."""
    first, others = (slice(0, 1), _FIRST_EVENT, 0), (slice(1, None), _OTHER_EVENT, 14)
    return [part for part, number in ((first, count), (others, count - 1)) if number > 0]
