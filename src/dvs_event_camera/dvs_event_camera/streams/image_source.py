"""Images of any usual encoding as arrays of luminosity."""

from __future__ import annotations

import importlib
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.cdr import CdrReader, MessageError
from dvs_common.wire.messages import ImageHead, image_head
from dvs_common.wire.stamped import Memo, stamp_of

# Luma of ITU-R BT.601, which is what mono8 cameras and OpenCV call grey.
_LUMA = {'r': 0.299, 'g': 0.587, 'b': 0.114, 'a': 0.0}
# An integer says no more than "less than half a grey level" where it says 0.
_DARKEST_INTEGER = 0.5
# Coordinates of an event are 16 bits wide.
_LARGEST_SIDE = 65536
_SCALARS = {
    '64FC1': 'f8',
    '32FC1': 'f4',
    'mono8': 'u1',
    '8UC1': 'u1',
    'mono16': 'u2',
    '16UC1': 'u2',
}
_COLOURS = {'rgb8': 'rgb', 'bgr8': 'bgr', 'rgba8': 'rgba', 'bgra8': 'bgra'}
ENCODINGS = (*_SCALARS, *_COLOURS)


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
        Luminosity below which the image can tell no difference; 0 for floating-point images.
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
        CDR bytes of an image with the encoding 64FC1, 32FC1, mono8, mono16, rgb8, bgr8, rgba8 or
        bgra8.

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
        stamp_ns=stamp_of(message), pixels=reading.pixels(message), darkest=reading.darkest
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reading:
    """Where the pixels of a stream's images stand, and how their bytes become numbers."""

    start: int
    end: int
    dtype: np.dtype[Any]
    height: int
    width: int
    row_bytes: int
    used_bytes: int
    channels: str
    darkest: float

    def pixels(self, message: bytes) -> NDArray[Any]:
        """Luminosity, shape (height, width)."""
        if self.row_bytes == self.used_bytes and not self.channels:
            count = self.height * self.width
            pixels = np.frombuffer(message, self.dtype, count, self.start)
            return pixels.reshape(self.height, self.width)
        octets = np.frombuffer(message, np.uint8, self.end - self.start, self.start)
        octets = octets.reshape(self.height, self.row_bytes)
        pixels = np.ascontiguousarray(octets[:, : self.used_bytes]).view(self.dtype)
        if not self.channels:
            return pixels
        return luma(pixels.reshape(self.height, self.width, -1), self.channels)


_known: Memo[_Reading] = Memo()


def _reading_of(head: ImageHead) -> _Reading:
    form = head.format
    scalar = _SCALARS.get(form.encoding)
    channels = _COLOURS.get(form.encoding, '')
    if scalar is None and not channels:
        raise MessageError(
            f'encoding {form.encoding!r} of the luminosity is not one of {", ".join(ENCODINGS)}'
        )
    if max(form.height, form.width) > _LARGEST_SIDE:
        raise MessageError(
            f'{form.height} x {form.width} pixels: an event knows {_LARGEST_SIDE} rows and columns'
        )
    order = '>' if form.big_endian else '<'
    dtype = np.dtype('u1' if scalar is None else order + scalar)
    used_bytes = form.width * dtype.itemsize * max(1, len(channels))
    if not form.height or not form.width or form.step < used_bytes:
        raise MessageError(
            f'{form.height} x {form.width} pixels of {form.encoding} do not fit rows of '
            f'{form.step} bytes'
        )
    return _Reading(
        start=head.start,
        end=head.end,
        dtype=dtype,
        height=form.height,
        width=form.width,
        row_bytes=form.step,
        used_bytes=used_bytes,
        channels=channels,
        darkest=0.0 if scalar in ('f8', 'f4') else _DARKEST_INTEGER,
    )


def luma(colours: NDArray[np.uint8], channels: str) -> NDArray[np.float32]:
    """Grey value of colours, shape (height, width).

    Parameters
    ----------
    colours
        Shape (height, width, len(channels)).
    channels
        Order of the channels, for example `bgr`.
    """
    grey = np.zeros(colours.shape[:2], np.float32)
    for position, channel in enumerate(channels):
        if _LUMA[channel]:
            grey += np.float32(_LUMA[channel]) * colours[..., position]
    return grey


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
    pixels = decode_picture(bytes(reader.octets()))
    return LuminosityFrame(stamp_ns=stamp_ns, pixels=pixels, darkest=_DARKEST_INTEGER)


def decode_picture(data: bytes) -> NDArray[Any]:
    """Grey values of an encoded picture, by OpenCV or else Pillow, shape (height, width).

    Parameters
    ----------
    data
        The picture as a file would hold it.

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
                return pixels
            failure = 'unknown picture format'
    raise MessageError(f'compressed image of {len(data)} bytes: {failure}')


def _decode_opencv(cv2: Any, data: bytes) -> NDArray[Any] | None:
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim == 2:
        return None if pixels is None else np.asarray(pixels)
    return luma(np.asarray(pixels), 'bgra'[: pixels.shape[2]])


def _decode_pillow(image_module: Any, data: bytes) -> NDArray[Any]:
    picture = image_module.open(io.BytesIO(data))
    if picture.mode in ('L', 'I;16'):
        return np.asarray(picture)
    return luma(np.asarray(picture.convert('RGB')), 'rgb')
