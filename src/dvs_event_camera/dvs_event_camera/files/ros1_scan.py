"""A bag of ROS 1 read record by record: one that was cut off, or whose index was never written.

Format: wiki.ros.org/Bags/Format/2.0. The index at the end is not needed: every whole message is
found, also those of an uncompressed chunk that is not whole.
"""

from __future__ import annotations

import bz2
import io
import struct
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from dvs_common.nanoseconds import NANOSECONDS
from dvs_event_camera.files.event_array import EVENT_ARRAY, event_array_from_ros1
from dvs_event_camera.files.mcap_scan import ScannedMessage

_MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_SIZE, _STAMP = struct.Struct('<I'), struct.Struct('<II')
_LARGEST_RECORD = 2**31


class Ros1Messages:
    """Messages of ROS 1 as ROS 2 would have them on the wire."""

    def __init__(self) -> None:
        self._typesys: Any = import_module('rosbags.typesys')
        # Whose Header has no seq, as in what is to come out.
        self._types = self._typesys.get_typestore(self._typesys.Stores.ROS2_JAZZY)

    def register(self, type_name: str, definition: str) -> None:
        """Learn a type, if it is not known.

        Parameters
        ----------
        type_name
            Message type as package/msg/Type.
        definition
            Its text, with those of its parts.
        """
        if type_name not in self._types.fielddefs:
            known = self._typesys.get_types_from_msg(definition, type_name)
            fielddefs = self._types.fielddefs
            self._types.register({k: v for k, v in known.items() if k not in fielddefs})

    def cdr(self, data: bytes, type_name: str) -> bytes:
        """CDR bytes of a message.

        Parameters
        ----------
        data
            Its bytes in ROS 1.
        type_name
            A type that was registered.
        """
        if type_name == EVENT_ARRAY:
            return event_array_from_ros1(data)
        return bytes(self._types.ros1_to_cdr(data, type_name))


def scan_ros1(path: Path) -> Iterator[ScannedMessage]:
    """Messages as they stand in the file.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ValueError
        After the last whole message, if the file does not end as it should.
    """
    with path.open('rb') as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError('is no bag of ROS 1')
        try:
            yield from _Scan().messages(file)
        except ValueError:
            raise
        # Libraries raise whatever their decompressors and parsers raise.
        except Exception as error:
            raise ValueError(f'is damaged: {error}') from None


class _Scan:
    """What is known of the connections so far: topic and type of each number."""

    def __init__(self) -> None:
        self._types = Ros1Messages()
        self._connections: dict[bytes, tuple[str, str]] = {}

    def messages(self, file: BinaryIO) -> Iterator[ScannedMessage]:
        while head := _part(file, may_end=True):
            fields = _fields(head)
            kind = fields.get('op', b'\0')[0]
            if kind == _CHUNK:
                yield from self.messages(_chunk(file, fields['compression']))
                continue
            data = _part(file)
            if kind == _CONNECTION:
                self._connect(fields, _fields(data))
            elif kind == _MESSAGE:
                topic, type_name = self._connections[fields['conn']]
                seconds, nanoseconds = _STAMP.unpack(fields['time'])
                yield ScannedMessage(
                    topic=topic,
                    type_name=type_name,
                    received_ns=seconds * NANOSECONDS + nanoseconds,
                    data=self._types.cdr(data, type_name),
                )

    def _connect(self, fields: dict[str, bytes], header: dict[str, bytes]) -> None:
        package, _, name = header['type'].decode().partition('/')
        type_name = f'{package}/msg/{name}'
        self._types.register(type_name, header['message_definition'].decode())
        self._connections[fields['conn']] = (fields['topic'].decode(), type_name)


def _chunk(file: BinaryIO, compression: bytes) -> BinaryIO:
    if compression == b'none':
        # Its records follow one another in the file, whole or not.
        _size(file)
        return file
    data = _part(file)
    if compression == b'bz2':
        return io.BytesIO(bz2.decompress(data))
    return io.BytesIO(import_module('lz4.frame').decompress(data))


def _size(file: BinaryIO) -> int:
    octets = file.read(4)
    if len(octets) < 4:
        raise ValueError('ends in the middle of a record')
    size: int = _SIZE.unpack(octets)[0]
    if size > _LARGEST_RECORD:
        raise ValueError(f'has a record of {size} bytes')
    return size


def _part(file: BinaryIO, *, may_end: bool = False) -> bytes:
    """Head or data of a record; empty at the end of the file, where there may be one."""
    if may_end:
        at = file.tell()
        if not file.read(1):
            return b''
        file.seek(at)
    size = _size(file)
    octets = file.read(size)
    if len(octets) < size:
        raise ValueError('ends in the middle of a record')
    return octets


def _fields(head: bytes) -> dict[str, bytes]:
    fields, at = {}, 0
    while at + 4 <= len(head):
        (size,) = _SIZE.unpack_from(head, at)
        name, _, value = head[at + 4 : at + 4 + size].partition(b'=')
        fields[name.decode()] = value
        at += 4 + size
    return fields
