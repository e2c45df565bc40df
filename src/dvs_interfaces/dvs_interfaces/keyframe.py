"""What travels on `keyframe`: the counts of every pixel, to be right again after a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_interfaces.cdr import MessageError
from dvs_interfaces.messages import pack_image, parse_image


@dataclass(frozen=True, slots=True, kw_only=True)
class Keyframe:
    """What a `keyframe` says: the state of every pixel at its stamp.

    Parameters
    ----------
    stamp_ns
        Sample after whose events the counts hold, ns.
    counts
        N, sum of the polarities so far, shape (r,), int64.
    signs
        Sign of every reference, shape (r,), int8.
    """

    stamp_ns: int
    counts: NDArray[np.int64]
    signs: NDArray[np.int8]


def pack_keyframe(keyframe: Keyframe, *, height: int, width: int, signed: bool) -> bytes:
    """Serialized sensor_msgs/Image: `32SC1` with N, or `32SC2` with N and the sign.

    Parameters
    ----------
    keyframe
        State of every pixel.
    height
        Rows of the pixel array.
    width
        Columns of the pixel array.
    signed
        Whether references can be negative, so that their signs must travel too.
    """
    counts = keyframe.counts.astype('<i4').reshape(height, width)
    if not signed:
        return pack_image(keyframe.stamp_ns, counts, '32SC1')
    signs = keyframe.signs.astype('<i4').reshape(height, width)
    return pack_image(keyframe.stamp_ns, np.stack([counts, signs], axis=-1), '32SC2')


def parse_keyframe(message: bytes) -> Keyframe:
    """Read a keyframe.

    Parameters
    ----------
    message
        CDR bytes of a sensor_msgs/Image.

    Raises
    ------
    MessageError
        If the encoding is neither `32SC1` nor `32SC2`, or the rows are not packed, or the message
        is cut short.
    """
    frame = parse_image(message)
    form = frame.format
    channels = {'32SC1': 1, '32SC2': 2}.get(form.encoding, 0)
    if not channels or form.big_endian or form.step != 4 * channels * form.width:
        raise MessageError(
            f'keyframe must be little-endian 32SC1 or 32SC2 with packed rows, is {form.encoding}'
        )
    pixels = np.frombuffer(frame.data, dtype='<i4').reshape(-1, channels)
    signs = pixels[:, 1] if channels == 2 else np.ones(len(pixels))
    return Keyframe(
        stamp_ns=frame.stamp_ns,
        counts=pixels[:, 0].astype(np.int64),
        signs=signs.astype(np.int8),
    )
