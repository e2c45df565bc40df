"""The flatbuffers of an AEDAT4 file, byte by byte.

Three shapes are all that a writer needs, so that they are written down here instead of generated:
the head of the file, a packet of events (structs of 16 bytes) and a packet of triggers (tables).
Positions count from the size that stands before each flatbuffer. Schemas: `ioheader.fbs`,
`events.fbs`, `trigger.fbs` of gitlab.com/inivation/dv.
"""

from __future__ import annotations

import struct
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
_TRIGGER_DTYPE = np.dtype(
    {
        'names': ['vtable', 'kind', 't'],
        'formats': ['<i4', 'u1', '<i8'],
        'offsets': [0, 4, 8],
        'itemsize': 16,
    }
)
_PACKET_HEAD = struct.Struct('<ii')
# Size, root, identifier; the vtable of one field; the table; the vector's place and length.
_ONE_VECTOR = struct.Struct('<II4sHHHxxiII')


def file_head(*, width: int, height: int, events: int, triggers: int) -> bytes:
    """First line and description of the streams.

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
    """
    size = {'sizeX': width, 'sizeY': height}
    text = (
        '<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">'
        + _stream(events, 'events', 'EVTS', 'Array of events (polarity ON/OFF).', size)
        + _stream(triggers, 'triggers', 'TRIG', 'Array of triggers.', {})
        + '</node></dv>'
    ).encode()
    # One vtable of three fields (compression and place of the data table by default), a table, a
    # string.
    body = struct.pack('<I4sHHHHHxxiII', 20, b'IOHE', 10, 8, 0, 0, 4, 12, 4, len(text))
    body += text + b'\0' * (4 - len(text) % 4)
    return MAGIC + struct.pack('<I', len(body)) + body


def _stream(number: int, name: str, kind: str, text: str, info: dict[str, int]) -> str:
    path = f'/mainloop/Recorder/outInfo/{number}/'
    attributes = {
        'compression': 'NONE',
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
    count = len(t)
    # Offsets to the tables, the vtable that they share, the tables; all at multiples of eight.
    vtable_at = _ONE_VECTOR.size + (4 * count + 7) // 8 * 8
    tables_at = vtable_at + 8 + (-vtable_at) % 8
    places = tables_at + _TRIGGER_DTYPE.itemsize * np.arange(count)
    offsets = (places - (_ONE_VECTOR.size + 4 * np.arange(count))).astype('<u4')
    tables = np.zeros(count, _TRIGGER_DTYPE)
    tables['vtable'], tables['kind'], tables['t'] = places - vtable_at, kinds, t
    content = offsets.tobytes().ljust(vtable_at - _ONE_VECTOR.size, b'\0')
    content += struct.pack('<HHHH', 8, _TRIGGER_DTYPE.itemsize, 8, 4) + tables.tobytes()
    return _packet(stream, _vector(b'TRIG', count, content))


def _vector(identifier: bytes, count: int, content: bytes) -> bytes:
    head = _ONE_VECTOR.pack(
        _ONE_VECTOR.size - 4 + len(content), 16, identifier, 6, 8, 4, 8, 4, count
    )
    return head + content


def _packet(stream: int, content: bytes) -> bytes:
    return _PACKET_HEAD.pack(stream, len(content)) + content
