"""Which events are noise: those that light did not cause, and those that undo them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_event_camera.pixels.pixel_events import PixelEvents

IndexArray = NDArray[np.int64]


@dataclass(slots=True)
class NoiseLabels:
    """Which events are noise: those that light did not cause, and those that undo them.

    Every pixel has an account of polarities that noise owes: an ON event that leakage is due, an
    OFF event after a spurious ON. The next event that pays is labelled. So the polarities of the
    events that are not labelled, less what is still owed, add up to the true change of the
    luminosity within two steps. (Leakage in falling light is owed for long: it silences OFF events
    instead of making ON events.)

    Parameters
    ----------
    owed
        Polarity owed by noise, shape (r,).
    leaked
        ON events due to leakage so far, shape (r,).
    kernels
        Module `pixel_kernels`, or None.
    """

    owed: IndexArray
    leaked: IndexArray
    kernels: Any = None

    @classmethod
    def of(cls, pixel_count: int, kernels: Any = None) -> NoiseLabels:
        """Nothing owed.

        Parameters
        ----------
        pixel_count
            Number of pixels r.
        kernels
            Module `pixel_kernels`, or None.
        """
        return cls(np.zeros(pixel_count, np.int64), np.zeros(pixel_count, np.int64), kernels)

    def label(self, events: PixelEvents, leaked: IndexArray | None) -> PixelEvents:
        """Label the events of an interval.

        Parameters
        ----------
        events
            Events with spurious ones labelled already.
        leaked
            ON events due to leakage by the end of the interval, shape (r,); None without leak.
        """
        if leaked is not None:
            self.owed += leaked - self.leaked
            self.leaked = leaked
        noise = np.zeros(len(events), np.int8) if events.noise is None else events.noise.copy()
        if self.kernels is not None:
            self.kernels.label_events(events.pixel, events.polarity, noise, self.owed)
            return events.labelled(noise)
        concerned = self.owed != 0
        concerned[events.pixel[noise > 0]] = True
        waiting = np.flatnonzero(concerned[events.pixel])
        waiting = waiting[np.argsort(events.pixel[waiting], kind='stable')]
        while waiting.size:
            # The first event of every pixel that is left.
            pixel = events.pixel[waiting]
            first = np.r_[True, pixel[1:] != pixel[:-1]]
            self._pay(events, noise, waiting[first])
            waiting = waiting[~first]
        return events.labelled(noise)

    def _pay(self, events: PixelEvents, noise: NDArray[np.int8], index: IndexArray) -> None:
        pixel, polarity = events.pixel[index], events.polarity[index].astype(np.int64)
        spurious = noise[index] > 0
        pays = ~spurious & (self.owed[pixel] * polarity > 0)
        noise[index[pays]] = 1
        self.owed[pixel[spurious | pays]] -= polarity[spurious | pays]
