"""The sum of polarities of every pixel of a packet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.wire.events import EventPacket

_INT16 = np.iinfo(np.int16)


def net_polarity(packet: EventPacket, shape: tuple[int, int]) -> NDArray[np.int16]:
    """Sum of polarities of every pixel, clipped to 16 bits, shape (height, width).

    Parameters
    ----------
    packet
        Events.
    shape
        Height and width of the camera.
    """
    height, width = shape
    events = packet.events
    pixel = events['y'].astype(np.int64) * width + events['x']
    net = np.bincount(pixel, weights=events['polarity'], minlength=height * width)
    return np.clip(net, _INT16.min, _INT16.max).astype(np.int16).reshape(height, width)
