"""The small messages as CDR bytes: std_msgs/Float64MultiArray and rosgraph_msgs/Clock."""

from __future__ import annotations

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import CdrReader, CdrWriter
from dvs_common.wire.stamped import stamped


def pack_array(values: FloatArray) -> bytes:
    """Serialized std_msgs/Float64MultiArray without dimensions.

    Parameters
    ----------
    values
        Entries, shape (k,).
    """
    writer = CdrWriter()
    writer.u32(0)
    writer.u32(0)
    writer.doubles(values)
    return writer.finish()


def parse_array(message: bytes) -> FloatArray:
    """Data of a serialized std_msgs/Float64MultiArray.

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
    for _ in range(reader.u32()):
        reader.text()
        reader.u32()
        reader.u32()
    reader.u32()
    return reader.doubles()


def pack_clock(stamp_ns: int) -> bytes:
    """Serialized rosgraph_msgs/Clock.

    Parameters
    ----------
    stamp_ns
        Simulated time, ns.
    """
    return stamped(stamp_ns)
