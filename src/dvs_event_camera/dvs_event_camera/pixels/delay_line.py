"""Events on their way out of the sensor: latency and jitter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_event_camera.pixels.pixel_events import PixelEvents


class DelayLine:
    """Delays events, keeps those that are not due and gives them out in order.

    Parameters
    ----------
    latency_ns
        Mean delay, ns.
    jitter_ns
        Standard deviation of the delay, ns; no delay is negative.
    rng
        Draws the jitter.
    kernels
        Module `pixel_kernels`, or None.
    """

    def __init__(
        self,
        latency_ns: float,
        jitter_ns: float,
        rng: np.random.Generator,
        kernels: Any = None,
    ) -> None:
        self._latency_ns, self._jitter_ns, self._rng = latency_ns, jitter_ns, rng
        self._kernels = kernels
        self._held = PixelEvents.empty()

    def pass_through(self, events: PixelEvents, stamp_ns: int) -> PixelEvents:
        """Take new events and return those due by `stamp_ns`.

        Parameters
        ----------
        events
            New events, sorted, none after `stamp_ns`.
        stamp_ns
            End of the interval, ns.
        """
        delay = self._latency_ns + self._jitter_ns * self._rng.standard_normal(len(events))
        late = events.delayed(np.rint(np.maximum(delay, 0.0)).astype(np.int64))
        waiting = PixelEvents.merged(self._held, late, self._kernels)
        due = int(np.searchsorted(waiting.t, stamp_ns, side='right'))
        self._held = waiting.take(slice(due, None))
        return waiting.take(slice(0, due))

    def held_counts(self, pixel_count: int) -> NDArray[np.int64]:
        """Sum of the polarities that are still on their way, shape (pixel_count,).

        Parameters
        ----------
        pixel_count
            Number of pixels r.
        """
        return np.bincount(
            self._held.pixel, weights=self._held.polarity, minlength=pixel_count
        ).astype(np.int64)
