"""Which events are noise: those that light did not cause, and those that undo them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.level_stages import Leak
from dvs_event_camera.pixels.pixel_events import PixelEvents

IndexArray = NDArray[np.int64]


class NoiseLabels:
    """Which events are noise: those that light did not cause, and those that undo them.

    Every pixel has an account of polarities that noise owes: an ON event that leakage is due, an
    OFF event after a spurious ON. The next event that pays is labelled. So the polarities of the
    events that are not labelled, less what is still owed, add up to the true change of the
    luminosity within two steps. (Leakage in falling light is owed for long: it silences OFF events
    instead of making ON events.)

    Parameters
    ----------
    pixel_count
        Number of pixels r.
    kernels
        Module `pixel_kernels`, or None.

    Attributes
    ----------
    owed
        Polarity owed by noise, shape (r,).
    """

    def __init__(self, pixel_count: int, kernels: Any = None) -> None:
        self.owed: IndexArray = np.zeros(pixel_count, np.int64)
        self._leaked: IndexArray = np.zeros(pixel_count, np.int64)
        self._kernels = kernels

    def label(
        self, events: PixelEvents, leak: Leak | None, stamp_ns: int, elapsed_ns: int
    ) -> PixelEvents:
        """Label the events of an interval.

        Parameters
        ----------
        events
            Events with spurious ones labelled already.
        leak
            What leaks, if anything does.
        stamp_ns
            End of the interval, ns.
        elapsed_ns
            Time from the first sample to then, ns.
        """
        if leak is not None:
            leaked = leak.due(elapsed_ns)
            self.owed += leaked - self._leaked
            self._leaked = leaked
        noise = np.zeros(len(events), np.int8) if events.noise is None else events.noise.copy()
        if self._kernels is not None:
            self._kernels.label_events(events.pixel, events.polarity, noise, self.owed)
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


class LevelNoiseLabels:
    """The same for pixels with `reset: level`, which owe nothing: an event settles everything.

    A spurious event is noise, and so is an ON event before which the pixel has leaked by more than
    half a threshold since its last event.
    """

    def __init__(self) -> None:
        self._last_ns: IndexArray | None = None

    def label(
        self, events: PixelEvents, leak: Leak | None, stamp_ns: int, elapsed_ns: int
    ) -> PixelEvents:
        """Label the events of an interval; see `NoiseLabels.label`.

        Parameters
        ----------
        events
            Events with spurious ones labelled already.
        leak
            What leaks, if anything does.
        stamp_ns
            End of the interval, ns.
        elapsed_ns
            Time from the first sample to then, ns.
        """
        noise = np.zeros(len(events), np.int8) if events.noise is None else events.noise.copy()
        if leak is None or not len(events):
            return events.labelled(noise)
        if self._last_ns is None:
            # The first events come sooner by the phases of the leak.
            self._last_ns = stamp_ns - elapsed_ns - leak.ahead_ns()
        order = np.argsort(events.pixel, kind='stable')
        pixel, t = events.pixel[order], events.t[order]
        first = np.r_[True, pixel[1:] != pixel[:-1]]
        since = t - np.where(first, self._last_ns[pixel], np.r_[0, t[:-1]])
        self._last_ns[pixel[np.r_[first[1:], True]]] = t[np.r_[first[1:], True]]
        leaked = leak.rates[pixel] * as_seconds(since) > 0.5
        noise[order[leaked & (events.polarity[order] > 0)]] = 1
        return events.labelled(noise)


def noise_labels_of(
    imperfections: Imperfections, pixel_count: int, kernels: Any = None
) -> NoiseLabels | LevelNoiseLabels:
    """Labels for an array of pixels.

    Parameters
    ----------
    imperfections
        Which noise the pixels have.
    pixel_count
        Number of pixels r.
    kernels
        Module `pixel_kernels`, or None.
    """
    if imperfections.reset == 'level':
        return LevelNoiseLabels()
    return NoiseLabels(pixel_count, kernels)
