"""Records of a pixel array or of events as serialized sensor_msgs/PointCloud2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_common.wire.events import FRAME_ID

# sensor_msgs/PointField datatypes.
_DATATYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Points:
    """Records of one message.

    Parameters
    ----------
    stamp_ns
        Stamp, ns.
    records
        Shape (height, width).
    """

    stamp_ns: int
    records: NDArray[np.void]


def pack_points(points: Points) -> bytes:
    """Serialized sensor_msgs/PointCloud2.

    Parameters
    ----------
    points
        Little-endian records.
    """
    records = np.ascontiguousarray(points.records)
    writer = CdrWriter()
    writer.stamp(points.stamp_ns)
    writer.text(FRAME_ID)
    height, width = records.shape
    writer.u32(height)
    writer.u32(width)
    fields = _fields(records.dtype)
    writer.u32(len(fields))
    for name, offset, datatype in fields:
        writer.text(name)
        writer.u32(offset)
        writer.u8(datatype)
        writer.u32(1)
    writer.u8(0)
    writer.u32(records.dtype.itemsize)
    writer.u32(width * records.dtype.itemsize)
    writer.octets(records.tobytes())
    writer.u8(1)
    return writer.finish()


def parse_points(message: bytes, dtype: np.dtype[np.void]) -> Points:
    """Records of a serialized sensor_msgs/PointCloud2.

    Parameters
    ----------
    message
        CDR bytes.
    dtype
        Type that its records must have, little-endian.

    Raises
    ------
    MessageError
        If the layout is another one or the message is cut short.
    """
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    reader.text()
    height, width = reader.u32(), reader.u32()
    fields = []
    for _ in range(reader.u32()):
        fields.append((reader.text(), reader.u32(), reader.u8()))
        reader.u32()
    big_endian, step, _ = reader.u8(), reader.u32(), reader.u32()
    if set(fields) != set(_fields(dtype)) or big_endian or step != dtype.itemsize:
        raise MessageError(
            f"fields {[name for name, _, _ in fields]} of {step} bytes are not the contract's: "
            f'{list(dtype.names or ())}, {dtype.itemsize} bytes, little-endian'
        )
    data = reader.octets()
    if len(data) != height * width * step:
        raise MessageError(f'{height} x {width} records do not fit {len(data)} bytes of data')
    records = np.frombuffer(data, dtype).reshape(height, width)
    return Points(stamp_ns=stamp_ns, records=records)


def _fields(dtype: np.dtype[np.void]) -> list[tuple[str, int, int]]:
    fields: Mapping[str, Any] = dtype.fields or {}
    return [
        (name, int(entry[1]), _DATATYPES[entry[0].str[1:]])
        for name, entry in sorted(fields.items(), key=lambda item: item[1][1])
    ]
