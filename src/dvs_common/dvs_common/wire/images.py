"""sensor_msgs/Image as CDR bytes: luminosity, and what cameras publish."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import CdrReader, CdrWriter, MessageError
from dvs_common.wire.events import FRAME_ID
from dvs_common.wire.stamped import BODY, Memo, stamp_of, stamped


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFormat:
    """What is the same in all images of a stream.

    Parameters
    ----------
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
    """

    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFrame:
    """A sensor_msgs/Image with its pixels still in wire form.

    Parameters
    ----------
    stamp_ns
        Sample time, ns.
    format
        Size and encoding.
    data
        Bytes, ``height * step`` of them.
    """

    stamp_ns: int
    format: ImageFormat
    data: memoryview


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageHead:
    """Where the data of a serialized image stand, and how they are to be read.

    Parameters
    ----------
    start
        Where the data begin in the message, bytes.
    end
        Where they end.
    format
        Size and encoding.
    """

    start: int
    end: int
    format: ImageFormat


_known_images: Memo[ImageHead] = Memo()
_CHROMA_BELOW = ('nv12', 'nv21')


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
    head = _image_head(pixels.shape[0], pixels.shape[1], encoding, pixels.nbytes)
    octets = np.ascontiguousarray(pixels).data
    return stamped(stamp_ns, head, octets, bytes(-pixels.nbytes % 4))


@functools.lru_cache(maxsize=16)
def _image_head(height: int, width: int, encoding: str, size: int) -> bytes:
    writer = CdrWriter()
    writer.stamp(0)
    writer.text(FRAME_ID)
    writer.u32(height)
    writer.u32(width)
    writer.text(encoding)
    writer.u8(0)
    writer.u32(size // height)
    writer.u32(size)
    return writer.finish()[BODY:]


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
    stamp_ns = stamp_of(message)
    head = image_head(message)
    data = memoryview(message)[head.start : head.end]
    return ImageFrame(stamp_ns=stamp_ns, format=head.format, data=data)


def image_head(message: bytes) -> ImageHead:
    """Find the data of a serialized sensor_msgs/Image.

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short or its data does not fill its rows.
    """
    head = _known_images.find(message) or _read_image_head(message)
    if len(message) < head.end:
        raise MessageError(f'image ends {head.end - len(message)} bytes too early')
    return head


def _read_image_head(message: bytes) -> ImageHead:
    reader = CdrReader(message)
    reader.stamp()
    reader.text()
    form = ImageFormat(
        height=reader.u32(),
        width=reader.u32(),
        encoding=reader.text(),
        big_endian=bool(reader.u8()),
        step=reader.u32(),
    )
    size = reader.u32()
    rows = form.height * form.step
    # Some drivers count the rows of luma alone where rows of chroma follow them.
    if size != rows and not (form.encoding in _CHROMA_BELOW and 2 * size == 3 * rows):
        raise MessageError(
            f'{form.height} rows of {form.step} bytes do not fit {size} bytes of data'
        )
    head = ImageHead(start=reader.position, end=reader.position + size, format=form)
    _known_images.add(message, head.start, head)
    return head


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
    form = frame.format
    if form.encoding != '64FC1' or form.big_endian or form.step != 8 * form.width:
        raise MessageError(
            f'luminosity must be little-endian 64FC1 with packed rows, is {form.encoding}'
        )
    return np.frombuffer(frame.data, dtype='<f8')
