"""What travels on ``events``: one packet of polarity events per luminosity sample.

A record has 16 bytes and any PointCloud2 tool can read it; docs/wire_contract.md has the table.
"""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_common.wire.stamped import BODY, stamp_of, stamped

EVENT_DTYPE = np.dtype(
    {
        'names': ['x', 'y', 't', 'index', 'polarity', 'sign'],
        'formats': ['<u2', '<u2', '<i4', '<u4', 'i1', 'i1'],
        'offsets': [0, 2, 4, 8, 12, 13],
        'itemsize': 16,
    }
)
# The same record with the label of `events_label` in what is padding otherwise.
LABELLED_EVENT_DTYPE = np.dtype(
    {
        'names': ['x', 'y', 't', 'index', 'polarity', 'sign', 'noise'],
        'formats': ['<u2', '<u2', '<i4', '<u4', 'i1', 'i1', 'u1'],
        'offsets': [0, 2, 4, 8, 12, 13, 14],
        'itemsize': 16,
    }
)
NO_EVENTS: NDArray[np.void] = np.empty(0, EVENT_DTYPE)
FRAME_ID = 'pixels'
INDEX_MODULUS = 2**32
LONGEST_INTERVAL_NS = 2**31 - 1

# sensor_msgs/PointField datatypes.
_INT8, _UINT8, _UINT16, _INT32, _UINT32 = 1, 2, 4, 5, 6
_FIELDS = (
    ('x', 0, _UINT16),
    ('y', 2, _UINT16),
    ('t', 4, _INT32),
    ('index', 8, _UINT32),
    ('polarity', 12, _INT8),
    ('sign', 13, _INT8),
)
_LABEL_FIELD = ('noise', 14, _UINT8)
# is_dense, filled up to a multiple of four bytes.
_TAIL = b'\x01\0\0\0'
_U32 = struct.Struct('<I')
_TWO_U32 = struct.Struct('<II')


@dataclass(frozen=True, slots=True, kw_only=True)
class EventPacket:
    """Events of one interval that ends at `stamp_ns`.

    Parameters
    ----------
    stamp_ns
        End of the interval covered, ns.
    events
        Records of `EVENT_DTYPE` or `LABELLED_EVENT_DTYPE`, shape (E,), sorted by (t, y, x); ``t``
        is in ns relative to `stamp_ns`, <= 0; ``index`` is the running event number modulo 2^32.
    """

    stamp_ns: int
    events: NDArray[np.void]


def event_times_ns(cloud: Any) -> NDArray[np.int64]:
    """Absolute times of the events of a packet, ns, shape (E,).

    The times in a packet are INT32 before its stamp: added to a stamp without a wider type they
    overflow.

    Parameters
    ----------
    cloud
        An `EventPacket`, a sensor_msgs/PointCloud2 of `events`, or its CDR bytes.

    Raises
    ------
    MessageError
        If it does not have the layout of the wire contract.
    """
    if isinstance(cloud, (bytes, bytearray)):
        cloud = parse_events(bytes(cloud))
    if isinstance(cloud, EventPacket):
        packet: EventPacket = cloud
        return packet.stamp_ns + packet.events['t'].astype(np.int64)
    fields = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    if fields.get('t') != (4, _INT32) or cloud.point_step != EVENT_DTYPE.itemsize:
        raise MessageError(f'fields {fields} are not those of an event packet')
    events = np.frombuffer(cloud.data, EVENT_DTYPE)
    stamp_ns: int = cloud.header.stamp.sec * NANOSECONDS + cloud.header.stamp.nanosec
    return stamp_ns + events['t'].astype(np.int64)


def make_events(
    *,
    times_ns: NDArray[np.int64],
    pixels: NDArray[np.integer],
    polarities: NDArray[np.int8],
    signs: NDArray[np.int8],
    width: int,
    stamp_ns: int,
    first_index: int,
) -> NDArray[np.void]:
    """Records of `EVENT_DTYPE` from columns, shape (E,).

    Two 64-bit words an event are much faster than filling the fields of a structured array.

    Parameters
    ----------
    times_ns
        Instants, ns, shape (E,).
    pixels
        Row-major pixel numbers, shape (E,).
    polarities
        +1 or -1, shape (E,).
    signs
        Sign of the reference, +1 or -1, shape (E,).
    width
        Columns of the pixel array.
    stamp_ns
        Stamp of the packet, ns.
    first_index
        Running number of the first event.
    """
    count = len(times_ns)
    if count == 0:
        return NO_EVENTS
    words = np.empty((count, 2), dtype='<u8')
    row, column = np.divmod(pixels.astype(np.uint64), np.uint64(width))
    relative = (times_ns - stamp_ns).astype(np.int32).view(np.uint32).astype(np.uint64)
    words[:, 0] = column | row << np.uint64(16) | relative << np.uint64(32)
    index = (first_index + np.arange(count, dtype=np.uint64)) % np.uint64(INDEX_MODULUS)
    polarity = polarities.view(np.uint8).astype(np.uint64) << np.uint64(32)
    words[:, 1] = index | polarity | signs.view(np.uint8).astype(np.uint64) << np.uint64(40)
    return words.reshape(-1).view(EVENT_DTYPE)


def pack_events(packet: EventPacket) -> bytes:
    """Return `packet` as a serialized sensor_msgs/PointCloud2.

    Parameters
    ----------
    packet
        Events to publish.
    """
    events = packet.events
    layout = _layout(events.dtype == LABELLED_EVENT_DTYPE)
    count = len(events)
    if not count:
        return stamped(packet.stamp_ns, layout.no_events)
    size = count * EVENT_DTYPE.itemsize
    return stamped(
        packet.stamp_ns,
        layout.before_count,
        _U32.pack(count),
        layout.after_count,
        _TWO_U32.pack(size, size),
        np.ascontiguousarray(events).view(np.uint8).data,
        _TAIL,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """The bytes that are the same in all packets: between stamp, count, size and events."""

    before_count: bytes
    after_count: bytes
    count_at: int
    events_at: int
    # All that follows the stamp of a packet without events.
    no_events: bytes


@functools.cache
def _layout(labelled: bool) -> _Layout:
    fields = (*_FIELDS, _LABEL_FIELD) if labelled else _FIELDS
    writer = CdrWriter()
    writer.stamp(0)
    writer.text(FRAME_ID)
    writer.u32(1)
    count_at = writer.size
    writer.u32(0)
    writer.u32(len(fields))
    for name, offset, datatype in fields:
        writer.text(name)
        writer.u32(offset)
        writer.u8(datatype)
        writer.u32(1)
    writer.u8(0)
    writer.u32(EVENT_DTYPE.itemsize)
    size_at = writer.size
    writer.u32(0)
    writer.u32(0)
    head = writer.finish()
    return _Layout(
        before_count=head[BODY:count_at],
        after_count=head[count_at + 4 : size_at],
        count_at=count_at,
        events_at=len(head),
        no_events=head[BODY:] + _TAIL,
    )


def parse_events(message: bytes) -> EventPacket:
    """Events of a serialized sensor_msgs/PointCloud2.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the layout is not the one of the wire contract, or the message is cut short.
    """
    stamp_ns = stamp_of(message)
    layout = _layout(False)
    if message.startswith(layout.no_events, BODY):
        events = NO_EVENTS
    elif _is_ours(message, layout):
        (count,) = _U32.unpack_from(message, layout.count_at)
        events = np.frombuffer(message, EVENT_DTYPE, count, layout.events_at)
    else:
        events = _parse_any(message)
    return EventPacket(stamp_ns=stamp_ns, events=events)


def _is_ours(message: bytes, layout: _Layout) -> bool:
    """Whether a message is whole and laid out as `pack_events` does it."""
    if len(message) <= layout.events_at:
        return False
    (count,) = _U32.unpack_from(message, layout.count_at)
    _, size = _TWO_U32.unpack_from(message, layout.events_at - _TWO_U32.size)
    return bool(
        message.startswith(layout.before_count, BODY)
        and message.startswith(layout.after_count, layout.count_at + 4)
        and size == count * EVENT_DTYPE.itemsize
        and len(message) > layout.events_at + size
    )


def _parse_any(message: bytes) -> NDArray[np.void]:
    """Events of a packet whatever its writer."""
    reader = CdrReader(message)
    reader.stamp()
    reader.text()
    count = reader.u32() * reader.u32()
    dtype = _parse_layout(reader)
    reader.u32()
    data = reader.octets()
    reader.u8()
    if len(data) != count * EVENT_DTYPE.itemsize:
        raise MessageError(f'{count} events do not fit {len(data)} bytes of data')
    return np.frombuffer(data, dtype=dtype)


def _parse_layout(reader: CdrReader) -> np.dtype[np.void]:
    """Read fields, byte order and point_step of whatever writer; return the record's type."""
    fields = []
    for _ in range(reader.u32()):
        fields.append((reader.text(), reader.u32(), reader.u8()))
        reader.u32()
    if not set(_FIELDS) <= set(fields):
        raise MessageError(f'fields {fields} are not those of an event packet: {list(_FIELDS)}')
    big_endian, point_step = reader.u8(), reader.u32()
    if big_endian or point_step != EVENT_DTYPE.itemsize:
        raise MessageError(
            f'point_step {point_step} must be {EVENT_DTYPE.itemsize}, little-endian'
        )
    return LABELLED_EVENT_DTYPE if _LABEL_FIELD in fields else EVENT_DTYPE
