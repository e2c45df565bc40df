"""Images of any usual encoding as arrays of luminosity."""

from __future__ import annotations

import importlib
import io
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FEW_FLOATS
from dvs_common.wire.cdr import CdrReader, MessageError
from dvs_common.wire.messages import ImageHead, image_head
from dvs_common.wire.stamped import Memo, stamp_of
from dvs_event_camera.streams.encodings import Encoding, encoding_named, luma

# An integer of 0 stands for anything less than half a grey level.
_DARKEST_INTEGER = 0.5
# Coordinates of an event are 16 bits wide.
_LARGEST_SIDE = 65536


@dataclass(frozen=True, slots=True, kw_only=True)
class LuminosityFrame:
    """Luminosity of a pixel array at one instant.

    Parameters
    ----------
    stamp_ns
        Sample time, ns.
    pixels
        Luminosity, shape (height, width), any number type; 0 to 255 or 65535 for integer images.
    darkest
        Luminosity below which the image shows no difference; 0 for floating-point images.
    """

    stamp_ns: int
    pixels: NDArray[Any]
    darkest: float


def parse_luminosity(message: bytes) -> LuminosityFrame:
    """Luminosity of a serialized sensor_msgs/Image; colours become luma (BT.601).

    Single channels are not copied.

    Parameters
    ----------
    message
        CDR bytes of an image in one of `encodings.ENCODINGS`.

    Raises
    ------
    MessageError
        If the encoding is another one, the rows are too short for it, or the message is cut short.
    """
    reading = _known.find(message)
    if reading is None or len(message) < reading.end:
        reading = _reading_of(image_head(message))
        _known.add(message, reading.start, reading)
    return LuminosityFrame(
        stamp_ns=stamp_of(message),
        pixels=reading.pixels(message),
        darkest=darkest_of(reading.encoding.dtype),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FewPixels:
    """How the images of a stream of a few doubles are read without an array.

    Parameters
    ----------
    start
        Where the pixels begin in a message, bytes.
    numbers
        All of them.
    shape
        Height and width.
    """

    start: int
    numbers: struct.Struct
    shape: tuple[int, int]

    def luminosity(self, message: bytes) -> tuple[float, ...]:
        """Luminosity of every pixel, row-major.

        Parameters
        ----------
        message
            CDR bytes of an image of the stream.
        """
        return self.numbers.unpack_from(message, self.start)


def few_pixels(message: bytes) -> FewPixels | None:
    """How to read an image of a stream that `parse_luminosity` has met; None for any other.

    Parameters
    ----------
    message
        CDR bytes.
    """
    reading = _known.find(message)
    return None if reading is None or len(message) < reading.end else reading.few


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reading:
    """Where the pixels of a stream's images stand, and how their bytes become numbers."""

    start: int
    end: int
    encoding: Encoding
    height: int
    width: int
    row_bytes: int
    used_bytes: int
    # None where the pixels are many, or no packed doubles.
    few: FewPixels | None

    def pixels(self, message: bytes) -> NDArray[Any]:
        """Luminosity, shape (height, width)."""
        encoding = self.encoding
        if self.row_bytes == self.used_bytes and encoding.samples == 1:
            count = self.height * self.width
            pixels = np.frombuffer(message, encoding.dtype, count, self.start)
            return pixels.reshape(self.height, self.width)
        octets = np.frombuffer(message, np.uint8, self.height * self.row_bytes, self.start)
        octets = octets.reshape(self.height, self.row_bytes)
        samples = np.ascontiguousarray(octets[:, : self.used_bytes]).view(encoding.dtype)
        if encoding.samples == 1:
            return samples
        if not encoding.channels:
            return np.ascontiguousarray(samples[:, encoding.first_luma :: encoding.samples])
        return luma(samples.reshape(self.height, self.width, -1), encoding.channels)


_known: Memo[_Reading] = Memo()


def _reading_of(head: ImageHead) -> _Reading:
    form = head.format
    encoding = encoding_named(form.encoding, big_endian=form.big_endian)
    height = encoding.luma_rows((head.end - head.start) // form.step if form.step else 0)
    if max(height, form.width) > _LARGEST_SIDE:
        raise MessageError(
            f'{height} x {form.width} pixels: coordinates of an event end at {_LARGEST_SIDE}'
        )
    used_bytes = form.width * encoding.dtype.itemsize * encoding.samples
    if not height or not form.width or form.step < used_bytes:
        raise MessageError(
            f'{form.height} x {form.width} pixels of {form.encoding} do not fit rows of '
            f'{form.step} bytes'
        )
    count = height * form.width
    packed = form.encoding == '64FC1' and not form.big_endian and form.step == used_bytes
    shape = height, form.width
    few = FewPixels(start=head.start, numbers=struct.Struct(f'<{count}d'), shape=shape)
    return _Reading(
        start=head.start,
        end=head.end,
        encoding=encoding,
        height=height,
        width=form.width,
        row_bytes=form.step,
        used_bytes=used_bytes,
        few=few if packed and count <= FEW_FLOATS else None,
    )


def parse_compressed(message: bytes) -> LuminosityFrame:
    """Luminosity of a serialized sensor_msgs/CompressedImage (JPEG, PNG, ...).

    Parameters
    ----------
    message
        CDR bytes.

    Raises
    ------
    MessageError
        If the message is cut short, the picture can't be decoded, or no decoder is installed.
    """
    reader = CdrReader(message)
    stamp_ns = reader.stamp()
    reader.text()
    reader.text()
    return decode_picture(bytes(reader.octets()), stamp_ns)


def darkest_of(dtype: np.dtype[Any]) -> float:
    """Luminosity below which numbers of this type show no difference; 0 for floats.

    Parameters
    ----------
    dtype
        Number type of a picture.
    """
    return 0.0 if dtype.kind == 'f' else _DARKEST_INTEGER


def decode_picture(data: bytes, stamp_ns: int = 0) -> LuminosityFrame:
    """Grey values of an encoded picture, by OpenCV or else Pillow.

    Parameters
    ----------
    data
        The picture as a file would hold it.
    stamp_ns
        When it was taken, ns.

    Raises
    ------
    MessageError
        If it can't be decoded or no decoder is installed.
    """
    failure = 'neither OpenCV nor Pillow is installed'
    for name, decode in (('cv2', _decode_opencv), ('PIL.Image', _decode_pillow)):
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        try:
            pixels = decode(module, data)
        except (OSError, ValueError) as error:
            failure = str(error)
        else:
            if pixels is not None:
                grey = pixels if pixels.ndim == 2 else luma(pixels, 'bgra'[: pixels.shape[2]])
                return LuminosityFrame(
                    stamp_ns=stamp_ns, pixels=grey, darkest=darkest_of(pixels.dtype)
                )
            failure = 'unknown picture format'
    raise MessageError(f'compressed image of {len(data)} bytes: {failure}')


def _decode_opencv(cv2: Any, data: bytes) -> NDArray[Any] | None:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(str(error)) from None
    return None if pixels is None else np.asarray(pixels)


def _decode_pillow(image_module: Any, data: bytes) -> NDArray[Any]:
    picture = image_module.open(io.BytesIO(data))
    if picture.mode == 'L' or picture.mode[0] in 'IF':
        # 8, 16 or 32 bits or floats as they are: a conversion to RGB would clip them to 255.
        return np.asarray(picture)
    return np.asarray(picture.convert('RGB'))[..., ::-1]
