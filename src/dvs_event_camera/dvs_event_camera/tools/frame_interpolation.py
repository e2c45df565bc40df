"""Pictures between pictures, by optical flow: an approximation.

What moves is moved along, linearly in time; what appears, disappears or flickers in between is
blended. Events of such pictures are dated by a guess of the motion and not by a measurement.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError

# Parameters of Farneback's method as in OpenCV's own example.
_FLOW = {
    'pyr_scale': 0.5,
    'levels': 3,
    'winsize': 15,
    'iterations': 3,
    'poly_n': 5,
    'poly_sigma': 1.2,
    'flags': 0,
}

StampedFrames = Iterator[tuple[int, NDArray[Any]]]


def interpolated(frames: StampedFrames, factor: int) -> StampedFrames:
    """Frames with `factor` - 1 more between any two.

    Parameters
    ----------
    frames
        Time in ns and picture, shape (height, width), in order.
    factor
        How many times as many, >= 1.

    Raises
    ------
    ParameterError
        If OpenCV is not installed.
    """
    try:
        cv2: Any = import_module('cv2')
    except ImportError:
        raise ParameterError('interpolate', factor, 'needs OpenCV') from None
    earlier: tuple[int, NDArray[Any]] | None = None
    for stamp, frame in frames:
        if earlier is not None and earlier[1].shape == frame.shape:
            yield from _between(cv2, earlier, (stamp, frame), factor)
        yield stamp, frame
        earlier = stamp, frame


def _between(
    cv2: Any, one: tuple[int, NDArray[Any]], other: tuple[int, NDArray[Any]], factor: int
) -> StampedFrames:
    (start, first), (end, last) = one, other
    largest = max(float(first.max()), float(last.max()), 1e-300)
    grey = [np.clip(np.sqrt(f / largest) * 255, 0, 255).astype(np.uint8) for f in (first, last)]
    flow = cv2.calcOpticalFlowFarneback(*grey, None, **_FLOW)
    rows, columns = np.indices(first.shape, np.float32)
    for step in range(1, factor):
        share = step / factor
        moved = [
            cv2.remap(
                frame.astype(np.float32),
                columns + np.float32(sign) * flow[..., 0],
                rows + np.float32(sign) * flow[..., 1],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
            for frame, sign in ((first, -share), (last, 1 - share))
        ]
        picture = (1 - share) * moved[0] + share * moved[1]
        floor = 0.0 if first.dtype.kind == 'f' else 0.5
        yield start + (end - start) * step // factor, np.maximum(picture, floor)
