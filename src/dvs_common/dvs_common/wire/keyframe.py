"""What travels on `keyframe`: the counts of every pixel, to be right again after a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import pack_image, parse_image

# Type and number of channels; the first is N, the second the sign, the third what moved.
_CHANNELS = {'32SC1': ('<i4', 1), '32SC2': ('<i4', 2), '64FC3': ('<f8', 3)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Keyframe:
    """What a `keyframe` says: the state of every pixel at its stamp.

    Parameters
    ----------
    stamp_ns
        Sample after whose events the counts hold, ns.
    counts
        N, sum of the polarities since counting began at zero, shape (r,), int64.
    signs
        Sign of every reference, shape (r,), int8.
    moved
        ``log_b |q / q(0)|`` when that counting began, shape (r,): 0 at the first sample, and the
        sum of N h over all former thresholds after live changes of the threshold.
    """

    stamp_ns: int
    counts: NDArray[np.int64]
    signs: NDArray[np.int8]
    moved: FloatArray


def pack_keyframe(keyframe: Keyframe, *, height: int, width: int, signed: bool) -> bytes:
    """Serialized sensor_msgs/Image: `32SC1` with N, or `32SC2` with N and the sign.

    `64FC3` with N, sign and what moved, where counting began anew with another threshold.

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
    encoding = '64FC3' if keyframe.moved.any() else '32SC2' if signed else '32SC1'
    kind, channels = _CHANNELS[encoding]
    parts = [
        keyframe.counts.astype(kind),
        keyframe.signs.astype(kind),
        keyframe.moved.astype(kind),
    ]
    pixels = np.stack(parts[:channels], axis=-1).reshape(height, width, channels)
    return pack_image(keyframe.stamp_ns, pixels, encoding)


def parse_keyframe(message: bytes) -> Keyframe:
    """Read a keyframe.

    Parameters
    ----------
    message
        CDR bytes of a sensor_msgs/Image.

    Raises
    ------
    MessageError
        If the encoding is none of `32SC1`, `32SC2` and `64FC3`, or the rows are not packed, or the
        message is cut short, or counts are not whole, signs not +1 or -1 or references not finite.
    """
    frame = parse_image(message)
    form = frame.format
    kind, channels = _CHANNELS.get(form.encoding, ('<i4', 0))
    row = np.dtype(kind).itemsize * channels * form.width
    if not channels or form.big_endian or form.step != row:
        raise MessageError(
            'keyframe must be little-endian 32SC1, 32SC2 or 64FC3 with packed rows, is '
            f'{form.encoding}'
        )
    pixels = np.frombuffer(frame.data, dtype=kind).reshape(-1, channels)
    whole = np.all(np.isfinite(pixels)) and np.all(np.rint(pixels[:, :2]) == pixels[:, :2])
    if not whole or (channels > 1 and np.any(np.abs(pixels[:, 1]) != 1)):
        raise MessageError('keyframe must hold whole counts, signs +1 or -1 and finite references')
    return Keyframe(
        stamp_ns=frame.stamp_ns,
        counts=pixels[:, 0].astype(np.int64),
        signs=(pixels[:, 1] if channels > 1 else np.ones(len(pixels))).astype(np.int8),
        moved=pixels[:, 2].astype(np.float64) if channels > 2 else np.zeros(len(pixels)),
    )
