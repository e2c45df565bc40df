"""Events as points x, y, age for programs that draw any point cloud: RViz, rerun, ros2_numpy."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_common.wire.cdr import CdrWriter
from dvs_common.wire.events import FRAME_ID
from dvs_event_camera.pixels.pixel_events import PixelEvents

# sensor_msgs/PointField.FLOAT32
_FLOAT32 = 7
_POINT_BYTES = 12
# What a viewer still turns smoothly.
_MOST_POINTS = 500_000


class EventCloud:
    """Events of the last while.

    Parameters
    ----------
    width
        Columns of the sensor.
    window_s
        How long an event is shown, s.
    """

    def __init__(self, *, width: int, window_s: float) -> None:
        self._width = width
        self._window_ns = as_nanoseconds(window_s)
        self._times_ns = np.empty(0, np.int64)
        self._pixels = np.empty(0, np.int32)

    def add(self, events: PixelEvents, stamp_ns: int) -> None:
        """Collect events, and forget those that are too old.

        Parameters
        ----------
        events
            Events up to `stamp_ns`.
        stamp_ns
            Present, ns.
        """
        times = np.concatenate([self._times_ns, events.t])[-_MOST_POINTS:]
        pixels = np.concatenate([self._pixels, events.pixel])[-_MOST_POINTS:]
        recent = times > stamp_ns - self._window_ns
        self._times_ns, self._pixels = times[recent], pixels[recent]

    def points(self, stamp_ns: int) -> FloatArray:
        """Column, row and age of every event, s, float32, shape (k, 3).

        Parameters
        ----------
        stamp_ns
            Present, ns.
        """
        row, column = np.divmod(self._pixels, self._width)
        age = as_seconds(stamp_ns - self._times_ns)
        return np.stack([column, row, age], axis=1).astype('<f4')


def pack_cloud(stamp_ns: int, points: FloatArray) -> bytes:
    """Serialized sensor_msgs/PointCloud2 with the float32 fields x, y, z.

    Parameters
    ----------
    stamp_ns
        Stamp, ns.
    points
        float32, shape (k, 3).
    """
    writer = CdrWriter()
    writer.stamp(stamp_ns)
    writer.text(FRAME_ID)
    writer.u32(1)
    writer.u32(len(points))
    writer.u32(3)
    for position, name in enumerate('xyz'):
        writer.text(name)
        writer.u32(4 * position)
        writer.u8(_FLOAT32)
        writer.u32(1)
    writer.u8(0)
    writer.u32(_POINT_BYTES)
    writer.u32(_POINT_BYTES * len(points))
    writer.octets(points.tobytes())
    writer.u8(1)
    return writer.finish()
