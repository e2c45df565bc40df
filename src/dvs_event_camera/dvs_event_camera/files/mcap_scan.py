"""An MCAP file read record by record: one without its end, or that rosbags refuses.

Format: mcap.dev/spec. Nothing but the records is needed, so that every whole message of a
recording that was cut off is found, also those of a chunk that is not whole.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import BinaryIO

MAGIC = b'\x89MCAP0\r\n'
_DATA_END, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x0F, 0x03, 0x04, 0x05, 0x06
_RECORD = struct.Struct('<BQ')
_MESSAGE_HEAD = struct.Struct('<HIQQ')
# Times, size and checksum of a chunk, before the name of its compression.
_CHUNK_HEAD = 28
_LARGEST_RECORD = 2**32


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannedMessage:
    """A message found in the file.

    Parameters
    ----------
    topic
        Full name of its topic.
    type_name
        Message type.
    received_ns
        Log time, ns.
    data
        Its bytes.
    """

    topic: str
    type_name: str
    received_ns: int
    data: bytes


def scan_mcap(path: Path) -> Iterator[ScannedMessage]:
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
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError('is no MCAP file')
        for opcode, content in _records(file):
            if opcode == _SCHEMA:
                number, name = struct.unpack_from('<H', content)[0], text_at(content, 2)[0]
                schemas[number] = name
            elif opcode == _CHANNEL:
                number, schema = struct.unpack_from('<HH', content)
                channels[number] = (text_at(content, 4)[0], schemas.get(schema, ''))
            elif opcode == _MESSAGE:
                number, _, log_time, _ = _MESSAGE_HEAD.unpack_from(content)
                topic, type_name = channels[number]
                yield ScannedMessage(
                    topic=topic,
                    type_name=type_name,
                    received_ns=log_time,
                    data=content[_MESSAGE_HEAD.size :],
                )


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Records of the data section, those in chunks too; raises ValueError where it breaks."""
    while True:
        opcode, size = _RECORD.unpack(_exactly(file, _RECORD.size))
        if opcode == _DATA_END:
            return
        if opcode != _CHUNK:
            yield opcode, _exactly(file, size)
            continue
        head = _exactly(file, _CHUNK_HEAD)
        name = _exactly(file, struct.unpack('<I', _exactly(file, 4))[0]).decode('ascii', 'replace')
        (packed_size,) = struct.unpack('<Q', _exactly(file, 8))
        # The records of a chunk that is not compressed simply follow.
        if name:
            (whole_size,) = struct.unpack_from('<Q', head, 16)
            yield from _within(_decompressed(_exactly(file, packed_size), name, whole_size))


def _within(chunk: bytes) -> Iterator[tuple[int, bytes]]:
    file = io.BytesIO(chunk)
    while file.tell() < len(chunk):
        opcode, size = _RECORD.unpack(_exactly(file, _RECORD.size))
        yield opcode, _exactly(file, size)


def _decompressed(data: bytes, name: str, size: int) -> bytes:
    if name == 'zstd':
        zstandard = import_module('zstandard')
        try:
            found: bytes = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        except zstandard.ZstdError as error:
            raise ValueError(f'holds a broken chunk: {error}') from None
        return found
    if name == 'lz4':
        try:
            unpacked: bytes = import_module('lz4.frame').decompress(data)
        except RuntimeError as error:
            raise ValueError(f'holds a broken chunk: {error}') from None
        return unpacked
    raise ValueError(f'holds a chunk compressed with {name!r}')


def text_at(content: bytes, at: int) -> tuple[str, int]:
    """Text of an MCAP record, and where it ends.

    Parameters
    ----------
    content
        Content of the record.
    at
        Where the text begins with its size, bytes.
    """
    (size,) = struct.unpack_from('<I', content, at)
    end = at + 4 + size
    return content[at + 4 : end].decode('utf-8', 'replace'), end


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size) if size < _LARGEST_RECORD else b''
    if len(data) < size:
        raise ValueError('ends in the middle of a record')
    return data
