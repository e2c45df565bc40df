"""The other messages of the loop as CDR bytes: images, joint states, arrays, clock."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_interfaces.cdr import CdrReader, CdrWriter, MessageError
from dvs_interfaces.events import FRAME_ID
from dvs_interfaces.model import FloatArray

_AFTER_STAMP = 12
# Two empty sequences, as two of the three of a JointState are.
_NO_DOUBLES = bytes(8)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFrame:
    """A sensor_msgs/Image with its pixels still in wire form.

    Parameters
    ----------
    stamp_ns
        Sample time, ns.
    height
        Rows.
    width
        Columns.
    encoding
        Encoding as in sensor_msgs/image_encodings.
    big_endian
        Byte order of multi-byte pixels.
    step
        Bytes a row.
    data
        Bytes, ``height * step`` of them.
    """

    stamp_ns: int
    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int
    data: memoryview


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


def pack_image(stamp_ns: int, pixels: NDArray[np.generic], encoding: str) -> bytes:
    """Serialized sensor_msgs/Image.

    Parameters
    ----------
    stamp_ns
        Sample time, ns.
    pixels
        Array of shape (height, width) or (height, width, channels), little-endian.
    encoding
        Encoding as in sensor_msgs/image_encodings.
    """
    pixels = np.ascontiguousarray(pixels)
    height, width = pixels.shape[:2]
    writer = CdrWriter()
    writer.stamp(stamp_ns)
    writer.section(_image_layout(height, width, encoding, pixels.nbytes // height))
    writer.octets(pixels.tobytes())
    return writer.finish()


@functools.lru_cache(maxsize=16)
def _image_layout(height: int, width: int, encoding: str, step: int) -> bytes:
    writer = CdrWriter()
    writer.stamp(0)
    writer.text(FRAME_ID)
    writer.u32(height)
    writer.u32(width)
    writer.text(encoding)
    writer.u8(0)
    writer.u32(step)
    return writer.finish()[_AFTER_STAMP:]


def parse_image(message: bytes) -> ImageFrame:
    """Frame of a serialized sensor_msgs/Image; the pixels are not copied.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short or its data does not fill its rows.
    """
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    layout = reader.recall(_known_layouts)
    if layout is None:
        reader.text()
        layout = _Layout(
            height=reader.u32(),
            width=reader.u32(),
            encoding=reader.text(),
            big_endian=bool(reader.u8()),
            step=reader.u32(),
        )
        reader.remember(_known_layouts, _AFTER_STAMP, layout)
    data = reader.octets()
    if len(data) != layout.height * layout.step:
        raise MessageError(
            f'{layout.height} rows of {layout.step} bytes do not fit {len(data)} bytes of data'
        )
    return ImageFrame(
        stamp_ns=stamp_ns,
        height=layout.height,
        width=layout.width,
        encoding=layout.encoding,
        big_endian=layout.big_endian,
        step=layout.step,
        data=data,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """What is the same in all images of a stream."""

    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int


# A stream repeats the bytes between stamp and data: they are read once.
_known_layouts: dict[bytes, _Layout] = {}
_known_names: dict[bytes, tuple[str, ...]] = {}


def luminosity_image(frame: ImageFrame) -> FloatArray:
    """Pixels of a `64FC1` frame, shape (height * width,).

    Parameters
    ----------
    frame
        Frame from `parse_image`.

    Raises
    ------
    MessageError
        If the encoding is another one or the rows are not packed.
    """
    if frame.encoding != '64FC1' or frame.big_endian or frame.step != 8 * frame.width:
        raise MessageError(
            f'luminosity must be little-endian 64FC1 with packed rows, is {frame.encoding}'
        )
    return np.frombuffer(frame.data, dtype='<f8')


def pack_state(vector: Vector) -> bytes:
    """Serialized sensor_msgs/JointState with the values in ``position``.

    Parameters
    ----------
    vector
        State of the plant.
    """
    writer = CdrWriter()
    writer.stamp(vector.stamp_ns)
    writer.section(_joint_names(vector.names))
    writer.doubles(vector.values)
    writer.section(_NO_DOUBLES)
    return writer.finish()


def pack_command(vector: Vector) -> bytes:
    """Serialized sensor_msgs/JointState with the values in ``effort``.

    Parameters
    ----------
    vector
        Input u_o of the plant.
    """
    writer = CdrWriter()
    writer.stamp(vector.stamp_ns)
    writer.section(_joint_names(vector.names))
    writer.section(_NO_DOUBLES)
    writer.doubles(vector.values)
    return writer.finish()


@functools.lru_cache(maxsize=16)
def _joint_names(names: tuple[str, ...]) -> bytes:
    writer = CdrWriter()
    writer.stamp(0)
    writer.text('')
    writer.texts(names)
    return writer.finish()[_AFTER_STAMP:]


def parse_state(message: bytes) -> Vector:
    """Names and ``position`` of a serialized sensor_msgs/JointState.

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
    """Names and ``effort`` of a serialized sensor_msgs/JointState.

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


def _parse_joint_state(message: bytes, part: str) -> Vector:
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    names = reader.recall(_known_names)
    if names is None:
        reader.text()
        names = reader.remember(_known_names, _AFTER_STAMP, reader.texts())
    position, _, effort = reader.doubles(), reader.doubles(), reader.doubles()
    values = position if part == 'position' else effort
    if len(values) != len(names):
        raise MessageError(f'{len(names)} names but {len(values)} entries of {part}')
    return Vector(stamp_ns=stamp_ns, names=names, values=values)


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
    writer = CdrWriter()
    writer.stamp(stamp_ns)
    return writer.finish()
