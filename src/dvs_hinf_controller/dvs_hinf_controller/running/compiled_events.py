"""Packets of many events, moved through compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.cdr import MessageError
from dvs_hinf_controller.running.interval_arithmetic import require_finite
from dvs_hinf_controller.running.pixel_records import PixelRecords

_FIRST_REACH = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Events:
    """Events in the order of time.

    Parameters
    ----------
    pixels
        Row-major pixel of every event, shape (E,).
    polarities
        +1 or -1, shape (E,).
    signs
        Sign of the reference after the event, shape (E,).
    """

    pixels: NDArray[np.intp]
    polarities: NDArray[np.int8]
    signs: NDArray[np.int8]


class CompiledEvents:
    """Moves the records of the pixels through events, and back.

    Parameters
    ----------
    records
        Moved in place.
    step
        ``h ln b``.
    """

    def __init__(self, records: PixelRecords, step: float) -> None:
        self._records, self._step = records, step
        self._set_reach(_FIRST_REACH)

    def _set_reach(self, reach: int) -> None:
        self._reach = reach
        self._growth = np.exp(np.arange(-reach, reach + 1) * self._step)

    def take(self, kernels: Any, events: Events, active_count: int) -> FloatArray:
        """Count events and move the estimates; return the jump of their mean at each, shape (E,).

        Parameters
        ----------
        kernels
            Module `interval_kernels`.
        events
            What happens.
        active_count
            Number of active pixels.

        Raises
        ------
        MessageError
            If an estimate would leave the range of numbers; nothing has changed then.
        """
        records, size = self._records, len(events.pixels)
        self._before, self._signs_before = np.empty(size), np.empty(size, np.int8)
        jumps, taken = np.empty(size), 0
        while True:
            taken = kernels.advance(
                *(taken, events.pixels, events.polarities, events.signs),
                *(self._growth, self._reach, records.counts, records.signs, records.first),
                *(records.estimate, records.active, active_count, records.farthest),
                *(self._before, self._signs_before, jumps),
            )
            if taken == size:
                return jumps
            number = int(records.counts[events.pixels[taken]]) + int(events.polarities[taken])
            try:
                require_finite(np.array([number]) * self._step)
            except MessageError:
                self._take_back(kernels, events, taken)
                raise
            self._set_reach(2 * abs(number))

    def take_back(self, kernels: Any, events: Events) -> None:
        """Take back the events that were taken last.

        Parameters
        ----------
        kernels
            Module `interval_kernels`.
        events
            What happened.
        """
        self._take_back(kernels, events, len(events.pixels))

    def _take_back(self, kernels: Any, events: Events, taken: int) -> None:
        records = self._records
        kernels.take_back(
            *(taken, events.pixels, events.polarities),
            *(records.counts, records.signs, records.estimate),
            *(self._before, self._signs_before),
        )
