"""The flatbuffers of an AEDAT4 file, byte by byte.

Four shapes are all that a writer needs, so that they are written down here instead of generated:
the head of the file, a packet of events (structs of 16 bytes), a packet of triggers and the table
of all packets (tables). Positions count from the size that stands before each flatbuffer. Schemas:
`ioheader.fbs`, `events.fbs`, `trigger.fbs`, `file_data_table.fbs` of gitlab.com/inivation/dv.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

MAGIC = b'#!AER-DAT4.0\r\n'
EVENT_DTYPE = np.dtype(
    {
        'names': ['t', 'x', 'y', 'on'],
        'formats': ['<i8', '<i2', '<i2', 'u1'],
        'offsets': [0, 8, 10, 12],
        'itemsize': 16,
    }
)
# Fields in the order of their schemas; each table begins with the way back to its vtable.
_TRIGGER_DTYPE = np.dtype(
    {
        'names': ['vtable', 't', 'kind'],
        'formats': ['<i4', '<i8', 'u1'],
        'offsets': [0, 8, 4],
        'itemsize': 16,
    }
)
_PLACE_DTYPE = np.dtype(
    {
        'names': ['vtable', 'place', 'head', 'count', 'first', 'last'],
        'formats': ['<i4', '<i8', '<2i4', '<i8', '<i8', '<i8'],
        'offsets': [0, 8, 16, 24, 32, 40],
        'itemsize': 48,
    }
)
# Compression of all packets, by its number in `ioheader.fbs`. aestream takes no other.
_LZ4 = 1
PACKET_HEAD = struct.Struct('<ii')
# Size, root, identifier; the vtable of one field; the table; the vector's place and length.
_ONE_VECTOR = struct.Struct('<II4sHHHxxiII')


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketPlace:
    """Where a packet is in the file, and what it holds.

    Parameters
    ----------
    stream
        Number of the stream.
    place
        First byte behind the head of the packet.
    size
        Bytes behind the head.
    count
        Events or triggers.
    first
        Time of the first, microseconds.
    last
        Time of the last, microseconds.
    """

    stream: int
    place: int
    size: int
    count: int
    first: int
    last: int


def file_head(*, width: int, height: int, events: int, triggers: int, table_at: int = -1) -> bytes:
    """First line and description of the streams; its length does not depend on `table_at`.

    Parameters
    ----------
    width
        Columns of the sensor.
    height
        Rows of the sensor.
    events
        Number of the stream of events.
    triggers
        Number of the stream of triggers.
    table_at
        First byte of the table of packets, -1 where there is none.
    """
    size = {'sizeX': width, 'sizeY': height}
    text = (
        '<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">'
        + _stream(events, 'events', 'EVTS', 'Array of events (polarity ON/OFF).', size)
        + _stream(triggers, 'triggers', 'TRIG', 'Array of triggers.', {})
        + '</node></dv>'
    ).encode()
    # One vtable of three fields, a table, a string.
    body = struct.pack('<I4sHHHHHxx', 20, b'IOHE', 10, 20, 4, 8, 16)
    body += struct.pack('<iiqII', 12, _LZ4, table_at, 4, len(text))
    body += text + b'\0' * (4 - len(text) % 4)
    return MAGIC + struct.pack('<I', len(body)) + body


def _stream(number: int, name: str, kind: str, text: str, info: dict[str, int]) -> str:
    path = f'/mainloop/Recorder/outInfo/{number}/'
    attributes = {
        'compression': 'LZ4',
        'originalModuleName': 'dvs_event_camera',
        'originalOutputName': name,
        'typeDescription': text,
        'typeIdentifier': kind,
    }
    lines = ''.join(
        f'<attr key="{key}" type="string">{escape(value)}</attr>'
        for key, value in attributes.items()
    )
    sizes = ''.join(f'<attr key="{key}" type="int">{value}</attr>' for key, value in info.items())
    sizes += '<attr key="source" type="string">dvs_event_camera</attr>'
    return (
        f'<node name="{number}" path="{path}">{lines}'
        f'<node name="info" path="{path}info/">{sizes}</node></node>'
    )


def events_packet(stream: int, events: NDArray[np.void]) -> bytes:
    """Packet of events.

    Parameters
    ----------
    stream
        Number of the stream.
    events
        Records of `EVENT_DTYPE`, shape (E,).
    """
    return _packet(stream, _vector(b'EVTS', len(events), events.tobytes()))


def triggers_packet(stream: int, t: NDArray[np.int64], kinds: NDArray[np.uint8]) -> bytes:
    """Packet of triggers.

    Parameters
    ----------
    stream
        Number of the stream.
    t
        Times, microseconds, shape (K,).
    kinds
        Kinds of trigger, shape (K,).
    """
    tables = np.zeros(len(t), _TRIGGER_DTYPE)
    tables['t'], tables['kind'] = t, kinds
    return _packet(stream, _tables(b'TRIG', tables))


def packet_table(places: Sequence[PacketPlace]) -> bytes:
    """Table of the packets, which stands at the end of the file without a head of its own.

    Parameters
    ----------
    places
        All packets, in the order of the file.
    """
    tables = np.zeros(len(places), _PLACE_DTYPE)
    for table, at in zip(tables, places, strict=True):
        table['place'], table['head'] = at.place, (at.stream, at.size)
        table['count'], table['first'], table['last'] = at.count, at.first, at.last
    return _compressed(_tables(b'FTAB', tables))


def _tables(identifier: bytes, tables: NDArray[np.void]) -> bytes:
    """Vector of tables that share one vtable; fills in the way back to it."""
    count, itemsize = len(tables), tables.dtype.itemsize
    names, fields_of = tables.dtype.names, tables.dtype.fields
    assert names is not None
    assert fields_of is not None
    fields = [fields_of[name][1] for name in names[1:]]
    vtable = struct.pack(f'<{2 + len(fields)}H', 4 + 2 * len(fields), itemsize, *fields)
    # Offsets to the tables, the vtable, the tables; all at multiples of eight.
    vtable_at = _ONE_VECTOR.size + _eights(4 * count)
    tables_at = vtable_at + _eights(len(vtable))
    places = tables_at + itemsize * np.arange(count)
    offsets = (places - (_ONE_VECTOR.size + 4 * np.arange(count))).astype('<u4')
    tables['vtable'] = places - vtable_at
    content = offsets.tobytes().ljust(vtable_at - _ONE_VECTOR.size, b'\0')
    content += vtable.ljust(tables_at - vtable_at, b'\0') + tables.tobytes()
    return _vector(identifier, count, content)


def _compressed(content: bytes) -> bytes:
    frame: bytes = import_module('lz4.frame').compress(content)
    return frame


def _eights(size: int) -> int:
    return (size + 7) // 8 * 8


def _vector(identifier: bytes, count: int, content: bytes) -> bytes:
    head = _ONE_VECTOR.pack(
        _ONE_VECTOR.size - 4 + len(content), 16, identifier, 6, 8, 4, 8, 4, count
    )
    return head + content


def _packet(stream: int, content: bytes) -> bytes:
    compressed = _compressed(content)
    return PACKET_HEAD.pack(stream, len(compressed)) + compressed
