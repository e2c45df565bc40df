"""sensor_msgs/JointState as CDR bytes: ``command``, ``state`` and ``estimate``."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_common.wire.stamped import BODY, Memo, stamp_of, stamped

# The sequences of a JointState; all but one are empty in the loop's messages.
_PARTS = ('position', 'velocity', 'effort')
_NO_DOUBLES = bytes(8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """A stamped vector of named doubles: what ``command`` and ``state`` carry.

    Parameters
    ----------
    stamp_ns
        Sample time, ns.
    names
        Names of the entries.
    values
        Entries, shape (len(names),).
    """

    stamp_ns: int
    names: tuple[str, ...]
    values: FloatArray


def pack_state(vector: Vector) -> bytes:
    """Serialized sensor_msgs/JointState with the values in ``position``.

    Parameters
    ----------
    vector
        State of the plant.
    """
    head = _joint_head(vector.names, 'position', vector.values.size)
    return stamped(vector.stamp_ns, head, vector.values.tobytes(), _NO_DOUBLES)


@functools.lru_cache(maxsize=4)
def estimate_names(count: int) -> tuple[str, ...]:
    """Names of the entries of `estimate`: z1 to zr.

    Parameters
    ----------
    count
        Number of pixels r.
    """
    return tuple(f'z{i + 1}' for i in range(count))


def pack_estimate(stamp_ns: int, estimate: FloatArray) -> bytes:
    """Serialized sensor_msgs/JointState with z in ``position``.

    Parameters
    ----------
    stamp_ns
        Stamp of the sample, ns.
    estimate
        z of every pixel, shape (r,).
    """
    names = estimate_names(estimate.size)
    return pack_state(Vector(stamp_ns=stamp_ns, names=names, values=estimate))


def pack_command(vector: Vector) -> bytes:
    """Serialized sensor_msgs/JointState with the values in ``effort``.

    Parameters
    ----------
    vector
        Input u_o of the plant.
    """
    head = _joint_head(vector.names, 'effort', vector.values.size)
    return stamped(vector.stamp_ns, head, vector.values.tobytes())


@functools.lru_cache(maxsize=16)
def _joint_head(names: tuple[str, ...], part: str, count: int) -> bytes:
    writer = CdrWriter()
    writer.stamp(0)
    writer.text('')
    writer.texts(names)
    for _ in _PARTS[: _PARTS.index(part)]:
        writer.u32(0)
    writer.u32(count)
    if count:
        writer.align(8)
    return writer.finish()[BODY:]


def parse_state(message: bytes) -> Vector:
    """Names and ``position`` of a serialized sensor_msgs/JointState, by the names' numbers.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short or names and values differ in number.
    """
    return _parse_joint_state(message, 'position')


def parse_command(message: bytes) -> Vector:
    """Names and ``effort`` of a serialized sensor_msgs/JointState, by the names' numbers.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short or names and values differ in number.
    """
    return _parse_joint_state(message, 'effort')


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entries:
    """Where the values of a JointState stand, what they are called, and their order by name."""

    start: int
    # Bytes of a message that is whole.
    size: int
    part: str
    names: tuple[str, ...]
    # Places of the values by their numbered names; None where that is how they stand.
    order: list[int] | None


_known_joints: Memo[_Entries] = Memo()


def _parse_joint_state(message: bytes, part: str) -> Vector:
    stamp_ns = stamp_of(message)
    known = _known_joints.find(message)
    if known is None or known.part != part or len(message) < known.size:
        known = _read_joint_head(message, part)
    values = np.frombuffer(message, '<f8', len(known.names), known.start)
    if known.order is not None:
        values = values[known.order]
    return Vector(stamp_ns=stamp_ns, names=known.names, values=values)


def _read_joint_head(message: bytes, part: str) -> _Entries:
    reader = CdrReader(message)
    reader.stamp()
    reader.text()
    names = reader.texts()
    counts, ends = [], []
    for _ in _PARTS:
        counts.append(reader.doubles().size)
        ends.append(reader.position)
    which = _PARTS.index(part)
    count, end = counts[which], ends[which]
    if count != len(names):
        raise MessageError(f'{len(names)} names but {count} entries of {part}')
    order = _by_number(names)
    entries = _Entries(
        start=end - 8 * count,
        size=ends[-1],
        part=part,
        names=tuple(names[place] for place in order),
        order=None if order == list(range(count)) else order,
    )
    if not any(counts[:which]) and not any(counts[which + 1 :]):
        _known_joints.add(message, entries.start, entries)
    return entries


def _by_number(names: tuple[str, ...]) -> list[int]:
    """Places of the names ``u1``, ``u2``, ... in the order of their numbers; others stay."""
    found = [re.fullmatch(r'([a-z])(\d{1,9})', name) for name in names]
    if len({match and match[1] for match in found}) != 1 or None in found:
        return list(range(len(names)))
    return sorted(range(len(names)), key=lambda place: int(names[place][1:]))
