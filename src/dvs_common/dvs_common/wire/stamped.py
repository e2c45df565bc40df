"""Messages that begin with a stamp: a stream repeats the bytes after it, which are read once.

The loop's messages differ in their stamp and their numbers only. What stands between the two
(frame, names, sizes) is written and understood at the first message and recognised by its bytes
from then on.
"""

from __future__ import annotations

import struct
from typing import Generic, TypeVar

from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.wire.cdr import ENCAPSULATION, MessageError, require_plain, stamp_ns_of

# Where what follows the stamp begins.
BODY = 12

_HEAD = struct.Struct('<2s2xiI')
_STAMP = struct.Struct('<iI')
_Meaning = TypeVar('_Meaning')
_MEMO_SIZE = 4


def stamped(stamp_ns: int, *parts: bytes | memoryview) -> bytes:
    """Whole message of a stamp and what follows it.

    Parameters
    ----------
    stamp_ns
        Stamp, ns.
    *parts
        Bytes from `BODY` on.
    """
    return b''.join((ENCAPSULATION, _STAMP.pack(*divmod(stamp_ns, NANOSECONDS)), *parts))


def stamp_of(message: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header or a Time, ns.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short, not plain little-endian CDR, or its stamp is none.
    """
    try:
        encapsulation, seconds, nanoseconds = _HEAD.unpack_from(message)
    except struct.error:
        raise MessageError(f'message of {len(message)} bytes ends before its stamp') from None
    require_plain(encapsulation)
    return stamp_ns_of(seconds, nanoseconds)


class Memo(Generic[_Meaning]):
    """What the runs of bytes after the stamp of some streams mean.

    A message of a known stream is parsed in 1/5.7 of the time of a first one (`cycle_memo_gain` of
    ``scripts/bench.sh cycle``).
    """

    __slots__ = ('_known',)

    def __init__(self) -> None:
        self._known: dict[bytes, _Meaning] = {}

    def find(self, message: bytes) -> _Meaning | None:
        """Meaning of the run that follows the stamp, None if it is a new one.

        Parameters
        ----------
        message
            CDR bytes.
        """
        for run, meaning in self._known.items():
            if message.startswith(run, BODY):
                return meaning
        return None

    def add(self, message: bytes, end: int, meaning: _Meaning) -> None:
        """Remember a run, unless there are several already.

        Parameters
        ----------
        message
            CDR bytes.
        end
            Where the run ends.
        meaning
            What it means.
        """
        if len(self._known) < _MEMO_SIZE:
            self._known[message[BODY:end]] = meaning
