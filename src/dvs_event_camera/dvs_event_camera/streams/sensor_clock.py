"""From the clock of a sensor to ROS time.

A driver stamps a packet when it has it, which is the time of its first event and a delay that
jitters by milliseconds: header stamp plus the time within the packet makes packets overlap and go
back. The delay is never negative, so the packets that came quickest lie on the true line: stamps
are fitted from below by the line of least distance (Moon, Skelly and Towsley, "Estimation and
removal of clock skew from network delay measurements", INFOCOM 1999), and the time that is given
out follows it without ever going back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import NANOSECONDS

# The line is fitted to the quickest packet of each second of the last minute.
_BUCKET_NS = NANOSECONDS
_BUCKETS = 60
# Crystals are better than this; before there are ten seconds, they are taken to agree.
_MOST_DRIFT = 200e-6
_DRIFT_AFTER = 10
# A correction changes the length of a second by this much at most.
_SLEW = 0.02
# A sensor that goes back by more has started again; a difference above it is no jitter.
_RESTART_NS = NANOSECONDS


class SensorClock:
    """Fits the packets of one sensor and dates its events."""

    def __init__(self) -> None:
        # Sensor time and delay of the quickest packet by bucket.
        self._quickest: dict[int, tuple[int, int]] = {}
        self._given: tuple[int, int] | None = None

    def dates(self, sensor_ns: NDArray[np.int64], stamp_ns: int) -> NDArray[np.int64]:
        """ROS times of the events of the next packet, ns, shape (E,); they never go back.

        Parameters
        ----------
        sensor_ns
            Times of its events in the sensor's clock, ns, shape (E,).
        stamp_ns
            Stamp of the packet, ROS time, ns.
        """
        if not sensor_ns.size:
            return np.empty(0, np.int64)
        first, last = int(sensor_ns[0]), int(sensor_ns.max())
        if self._given is not None and first < self._given[0] - _RESTART_NS:
            self._quickest.clear()
            self._given = None
        self._learn(first, stamp_ns)
        origin = self._given or (first, self._line(first))
        rate = self._rate(origin, last)
        if rate is None:
            origin, rate = (first, self._line(first)), 1.0
        elapsed = np.maximum(np.maximum.accumulate(sensor_ns) - origin[0], 0)
        dates: NDArray[np.int64] = origin[1] + np.rint(elapsed * rate).astype(np.int64)
        self._given = (max(last, origin[0]), int(dates[-1]))
        return dates

    def _learn(self, sensor_ns: int, stamp_ns: int) -> None:
        bucket = sensor_ns // _BUCKET_NS
        delay = stamp_ns - sensor_ns
        known = self._quickest.get(bucket)
        if known is None or delay < known[1]:
            self._quickest[bucket] = (sensor_ns, delay)
        while len(self._quickest) > _BUCKETS:
            del self._quickest[min(self._quickest)]

    def _line(self, sensor_ns: int) -> int:
        """ROS time of an instant of the sensor on the fitted line."""
        points = np.array(sorted(self._quickest.values()))
        since = (points[:, 0] - sensor_ns).astype(np.float64)
        delays = points[:, 1] - points[0, 1]
        drift = _drift(since, delays.astype(np.float64))
        least = np.min(delays - drift * since)
        return sensor_ns + int(points[0, 1]) + round(float(least))

    def _rate(self, origin: tuple[int, int], last: int) -> float | None:
        """Seconds of ROS time a second of the sensor, from what was given out to the line."""
        elapsed = last - origin[0]
        if elapsed <= 0:
            return 1.0
        target = self._line(last) - origin[1]
        if abs(target - elapsed) > _RESTART_NS:
            return None
        return float(np.clip(target / elapsed, 1 - _SLEW, 1 + _SLEW))


def _drift(since: NDArray[np.float64], delays: NDArray[np.float64]) -> float:
    """Slope of the edge of the lower convex hull that spans the mean of the instants."""
    if len(since) < _DRIFT_AFTER:
        return 0.0
    hull: list[int] = []
    for i in range(len(since)):
        while len(hull) > 1 and _turns_down(since, delays, hull[-2], hull[-1], i):
            hull.pop()
        hull.append(i)
    middle = since.mean()
    right = next(k for k in range(1, len(hull)) if since[hull[k]] >= middle)
    left, right = hull[right - 1], hull[right]
    slope = (delays[right] - delays[left]) / (since[right] - since[left])
    return float(np.clip(slope, -_MOST_DRIFT, _MOST_DRIFT))


def _turns_down(x: NDArray[np.float64], y: NDArray[np.float64], a: int, b: int, c: int) -> bool:
    return bool((y[b] - y[a]) * (x[c] - x[a]) >= (y[c] - y[a]) * (x[b] - x[a]))
