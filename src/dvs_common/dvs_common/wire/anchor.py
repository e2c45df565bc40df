"""What travels on `anchor`: luminosity of every pixel, measured absolutely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import pack_image, parse_image

_ENCODINGS = {'64FC1': '<f8', '32FC1': '<f4', 'mono16': '<u2', 'mono8': 'u1'}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Anchor:
    """An absolute measurement.

    Parameters
    ----------
    stamp_ns
        Instant of the measurement, ns.
    luminosity
        y, shape (r,), in the unit of the model; a pixel where it is not > 0 was not measured.
    """

    stamp_ns: int
    luminosity: FloatArray


def pack_anchor(anchor: Anchor, *, height: int, width: int) -> bytes:
    """Serialized sensor_msgs/Image, `64FC1`.

    Parameters
    ----------
    anchor
        What was measured.
    height
        Rows of the pixel array.
    width
        Columns of the pixel array.
    """
    return pack_image(anchor.stamp_ns, anchor.luminosity.reshape(height, width), '64FC1')


def parse_anchor(message: bytes) -> Anchor:
    """Read an anchor; what is no luminosity, NaN among them, becomes 0: not measured.

    Parameters
    ----------
    message
        CDR bytes of a sensor_msgs/Image, one channel, little-endian.

    Raises
    ------
    MessageError
        If the encoding is none of 64FC1, 32FC1, mono16 and mono8 or the message is cut short.
    """
    frame = parse_image(message)
    form = frame.format
    kind = _ENCODINGS.get(form.encoding)
    size = np.dtype(kind or 'u1').itemsize
    if kind is None or (form.big_endian and size > 1) or form.step != size * form.width:
        raise MessageError(
            f'anchor must be little-endian {", ".join(_ENCODINGS)} with packed rows, is '
            f'{form.encoding}'
        )
    y = np.frombuffer(frame.data, kind).astype(np.float64)
    measured = np.isfinite(y) & (y > 0)
    return Anchor(stamp_ns=frame.stamp_ns, luminosity=np.where(measured, y, 0.0))
