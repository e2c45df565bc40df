"""Reading and writing of CDR, the bytes that ROS 2 messages are on the wire (OMG DDSI-RTPS, 9.3).

The loop's messages are packed and parsed here, without Python message objects: all messages of a
run take 1/7.9 of the time that the generated classes take (`cycle_cdr_gain` of
``scripts/bench.sh cycle``), and a core decodes a recorded bag without rclpy.
"""

from __future__ import annotations

import struct

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import shortened
from dvs_common.nanoseconds import NANOSECONDS

# Plain CDR, little-endian.
ENCAPSULATION = b'\x00\x01\x00\x00'

_U32 = struct.Struct('<I')
_U64 = struct.Struct('<Q')
_STAMP = struct.Struct('<iI')
_LONGEST_REASON = 400


class MessageError(ValueError):
    """A message that breaks the wire contract.

    Parameters
    ----------
    reason
        What is wrong with it; what it quotes of the message is cut short.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(shortened(reason, _LONGEST_REASON))


def require_plain(encapsulation: bytes) -> None:
    """Raise `MessageError` unless a message is plain little-endian CDR.

    Parameters
    ----------
    encapsulation
        First two bytes of the message.

    Raises
    ------
    MessageError
        If it is another representation.
    """
    if encapsulation != ENCAPSULATION[:2]:
        found = encapsulation.hex() or '(none)'
        raise MessageError(f'CDR encapsulation {found} is not plain little-endian (0001)')


def stamp_ns_of(seconds: int, nanoseconds: int) -> int:
    """Stamp of a builtin_interfaces/Time, ns.

    Parameters
    ----------
    seconds
        Its whole seconds.
    nanoseconds
        Its nanoseconds.

    Raises
    ------
    MessageError
        If the nanoseconds are a second or more.
    """
    if nanoseconds >= NANOSECONDS:
        raise MessageError(f'stamp with {nanoseconds} nanoseconds, must be less than a second')
    return seconds * NANOSECONDS + nanoseconds


class CdrWriter:
    """Grows one little-endian CDR message, field by field; what pads a field is zero.

    So equal messages are equal bytes, and two runs can be compared by their hashes. The generated
    classes leave in the padding what the memory held before: 15 forms of one command among 400
    (`cycle_generated_variants` of ``scripts/bench.sh cycle``).
    """

    __slots__ = ('_buffer',)

    def __init__(self) -> None:
        self._buffer = bytearray(ENCAPSULATION)

    @property
    def size(self) -> int:
        """Number of bytes so far, the encapsulation header included."""
        return len(self._buffer)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes, counted from the end of the encapsulation header."""
        self._buffer.extend(bytes(-(len(self._buffer) - 4) % size))

    def u8(self, value: int) -> None:
        """Append `value` as a byte or boolean."""
        self._buffer.append(value)

    def u32(self, value: int) -> None:
        """Append `value` as an unsigned 32-bit integer."""
        self.align(4)
        self._buffer += _U32.pack(value)

    def u64(self, value: int) -> None:
        """Append `value` as an unsigned 64-bit integer."""
        self.align(8)
        self._buffer += _U64.pack(value)

    def stamp(self, nanoseconds: int) -> None:
        """Append `nanoseconds` as a builtin_interfaces/Time."""
        self.align(4)
        self._buffer += _STAMP.pack(*divmod(nanoseconds, NANOSECONDS))

    def text(self, value: str) -> None:
        """Append `value` as a string."""
        encoded = value.encode() + b'\x00'
        self.u32(len(encoded))
        self._buffer += encoded

    def octets(self, value: bytes | memoryview) -> None:
        """Append `value` as a sequence of bytes."""
        self.u32(len(value))
        self._buffer += value

    def doubles(self, values: FloatArray) -> None:
        """Append `values` as a sequence of doubles."""
        self.u32(len(values))
        if len(values):
            self.align(8)
            self._buffer += np.ascontiguousarray(values, dtype='<f8').tobytes()

    def texts(self, values: tuple[str, ...]) -> None:
        """Append `values` as a sequence of strings."""
        self.u32(len(values))
        for value in values:
            self.text(value)

    def finish(self) -> bytes:
        """Return the whole message, filled up to a multiple of four bytes as it is on the wire."""
        self.align(4)
        return bytes(self._buffer)


class CdrReader:
    """Walks through one CDR message; every step checks that the bytes are there.

    Parameters
    ----------
    message
        Whole message with its encapsulation header.

    Raises
    ------
    MessageError
        If the encapsulation is not plain little-endian CDR.
    """

    __slots__ = ('_buffer', '_position')

    def __init__(self, message: bytes) -> None:
        require_plain(bytes(message[:2]))
        self._buffer = memoryview(message)
        self._position = 4

    @property
    def position(self) -> int:
        """Where the next field begins, its padding not counted."""
        return self._position

    def _take(self, size: int, alignment: int) -> int:
        start = self._position + -(self._position - 4) % alignment
        if size < 0 or start + size > len(self._buffer):
            raise MessageError(f'message ends {start + size - len(self._buffer)} bytes too early')
        self._position = start + size
        return start

    def u8(self) -> int:
        """Read a byte."""
        return self._buffer[self._take(1, 1)]

    def u32(self) -> int:
        """Read an unsigned 32-bit integer; raises `MessageError` at the end of the message."""
        start = (self._position + 3) & ~3
        try:
            (value,) = _U32.unpack_from(self._buffer, start)
        except struct.error:
            raise MessageError('message ends too early') from None
        self._position = start + 4
        return int(value)

    def u64(self) -> int:
        """Read an unsigned 64-bit integer."""
        return int(_U64.unpack_from(self._buffer, self._take(8, 8))[0])

    def stamp(self) -> int:
        """Read a builtin_interfaces/Time as nanoseconds."""
        return stamp_ns_of(*_STAMP.unpack_from(self._buffer, self._take(8, 4)))

    def text(self) -> str:
        """Read a string."""
        size = self.u32()
        start = self._take(size, 1)
        return bytes(self._buffer[start : start + max(size - 1, 0)]).decode('utf-8', 'replace')

    def octets(self) -> memoryview:
        """Read a sequence of bytes without copying it."""
        size = self.u32()
        start = self._take(size, 1)
        return self._buffer[start : start + size]

    def doubles(self) -> FloatArray:
        """Read a sequence of doubles."""
        size = self.u32()
        if not size:
            return np.empty(0)
        start = self._take(8 * size, 8)
        return np.frombuffer(self._buffer, dtype='<f8', count=size, offset=start)

    def texts(self) -> tuple[str, ...]:
        """Read a sequence of strings."""
        return tuple(self.text() for _ in range(self.u32()))
