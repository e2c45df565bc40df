"""Encodings of sensor_msgs/Image: where in a row the luminosity stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.cdr import MessageError

# Luma of ITU-R BT.601, which is what mono8 cameras and OpenCV call grey.
_LUMA = {'r': 0.299, 'g': 0.587, 'b': 0.114, 'a': 0.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoding:
    """How the bytes of a row become luminosities.

    Parameters
    ----------
    dtype
        Number type of a sample.
    samples
        Samples a pixel.
    channels
        Colours of the samples, for example `bgr`; empty where one sample is the luminosity.
    first_luma
        Which of the samples of the first pixel that is.
    chroma_rows
        Rows of chroma that follow two rows of luma and count as rows of the image.
    """

    dtype: np.dtype[Any]
    samples: int = 1
    channels: str = ''
    first_luma: int = 0
    chroma_rows: int = 0

    def luma_rows(self, rows: int) -> int:
        """Rows of luminosity in an image.

        Parameters
        ----------
        rows
            Rows of the image.

        Raises
        ------
        MessageError
            If luma and chroma do not share these rows.
        """
        if not self.chroma_rows:
            return rows
        if rows % (2 + self.chroma_rows):
            raise MessageError(
                f'{rows} rows: two of luma need {self.chroma_rows} of chroma below them'
            )
        return rows * 2 // (2 + self.chroma_rows)


def _known() -> dict[str, Encoding]:
    known = {
        '64FC1': Encoding(dtype=np.dtype('<f8')),
        '32FC1': Encoding(dtype=np.dtype('<f4')),
        'mono8': Encoding(dtype=np.dtype('u1')),
        '8UC1': Encoding(dtype=np.dtype('u1')),
        'mono16': Encoding(dtype=np.dtype('<u2')),
        '16UC1': Encoding(dtype=np.dtype('<u2')),
        '16SC1': Encoding(dtype=np.dtype('<i2')),
        '32SC1': Encoding(dtype=np.dtype('<i4')),
        '8UC3': Encoding(dtype=np.dtype('u1'), samples=3, channels='bgr'),
        '8UC4': Encoding(dtype=np.dtype('u1'), samples=4, channels='bgra'),
        '16UC3': Encoding(dtype=np.dtype('<u2'), samples=3, channels='bgr'),
        '16UC4': Encoding(dtype=np.dtype('<u2'), samples=4, channels='bgra'),
        'nv12': Encoding(dtype=np.dtype('u1'), chroma_rows=1),
        'nv21': Encoding(dtype=np.dtype('u1'), chroma_rows=1),
    }
    for channels in ('rgb', 'bgr', 'rgba', 'bgra'):
        for bits, dtype in (('8', 'u1'), ('16', '<u2')):
            known[channels + bits] = Encoding(
                dtype=np.dtype(dtype), samples=len(channels), channels=channels
            )
    for name in ('yuv422', 'uyvy'):
        known[name] = Encoding(dtype=np.dtype('u1'), samples=2, first_luma=1)
    for name in ('yuv422_yuy2', 'yuyv'):
        known[name] = Encoding(dtype=np.dtype('u1'), samples=2)
    for pattern in ('rggb', 'bggr', 'gbrg', 'grbg'):
        # Every pixel behind its own filter, as the sensor has it: nothing is interpolated.
        known[f'bayer_{pattern}8'] = Encoding(dtype=np.dtype('u1'))
        known[f'bayer_{pattern}16'] = Encoding(dtype=np.dtype('<u2'))
    return known


ENCODINGS = _known()


def encoding_named(name: str, *, big_endian: bool) -> Encoding:
    """Encoding of an image.

    Parameters
    ----------
    name
        As in sensor_msgs/image_encodings.
    big_endian
        Byte order of the samples.

    Raises
    ------
    MessageError
        If it is none from which a luminosity can be read.
    """
    found = ENCODINGS.get(name)
    if found is None:
        raise MessageError(
            f'encoding {name!r} of the luminosity is not one of {", ".join(ENCODINGS)}'
        )
    if not big_endian or found.dtype.itemsize == 1:
        return found
    return Encoding(
        dtype=found.dtype.newbyteorder('>'), samples=found.samples, channels=found.channels
    )


def luma(colours: NDArray[Any], channels: str) -> NDArray[np.float32]:
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
            grey += np.float32(_LUMA[channel]) * colours[..., position].astype(np.float32)
    return grey
