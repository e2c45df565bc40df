"""What an event needs of its pixel, side by side in memory, and the mean of very many pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.running.interval_arithmetic import Bools

# Half a line of the processor's cache: an event misses the cache once, not once an array.
_RECORD = np.dtype(
    [
        ('count', np.int64),
        ('first', np.float64),
        ('estimate', np.float64),
        ('sign', np.int8),
        ('active', np.bool_),
    ],
    align=True,
)
_LINE = 64
# Up to so many pixels the mean of all is worked out after every packet.
FEW_PIXELS = 1 << 15


class PixelRecords:
    """Count, sign, estimates and use of every pixel: columns of one array of records.

    Parameters
    ----------
    size
        Number of pixels r.

    Attributes
    ----------
    counts
        N, sum of the polarities so far, shape (r,).
    signs
        Sign of the reference, shape (r,).
    first
        Estimate at N = 0, shape (r,).
    estimate
        z, shape (r,).
    active
        Which pixels count in the mean, shape (r,).
    farthest
        Bound of all ``|N|``, int64, shape (1,).
    """

    def __init__(self, size: int) -> None:
        room = np.zeros(size * _RECORD.itemsize + _LINE, np.uint8)
        begin = -room.ctypes.data % _LINE
        records = room[begin : begin + size * _RECORD.itemsize].view(_RECORD)
        self.counts: NDArray[np.int64] = records['count']
        self.signs: NDArray[np.int8] = records['sign']
        self.first: FloatArray = records['first']
        self.estimate: FloatArray = records['estimate']
        self.active: Bools = records['active']
        self.signs[:] = 1
        self.farthest: NDArray[np.int64] = np.zeros(1, np.int64)

    def set_counts(self, counts: NDArray[np.int64], signs: NDArray[np.int8]) -> None:
        """Count on from here.

        Parameters
        ----------
        counts
            N, shape (r,).
        signs
            Sign of the reference, shape (r,).
        """
        self.counts[:], self.signs[:] = counts, signs
        self.farthest[0] = 0
        self.note_farthest(counts)

    def note_farthest(self, counts: NDArray[np.int64]) -> None:
        """Raise the bound of all ``|N|``.

        Parameters
        ----------
        counts
            N that pixels have come to, of any length.
        """
        self.farthest[0] = max(self.farthest[0], np.abs(counts).max())


class CarriedMean:
    """Mean of the estimates; of very many pixels it is carried on by the jumps at their events.

    It is worked out anew after as many events as there are pixels: an event costs the same for
    any number of pixels, and rounding does not add up.

    Parameters
    ----------
    records
        What is known of the pixels.
    """

    def __init__(self, records: PixelRecords) -> None:
        self._records, self._size = records, records.estimate.size
        self._value: float | None = None
        self._events = 0

    def of(self, active_count: int) -> float:
        """Mean over the active pixels; 0 if there are none.

        Parameters
        ----------
        active_count
            Number of active pixels.
        """
        if self._value is None:
            self._value, self._events = self._work_out(active_count), 0
        return self._value

    def _work_out(self, active_count: int) -> float:
        estimate = self._records.estimate
        if active_count == self._size:
            return float(estimate.mean())
        return float(estimate[self._records.active].mean()) if active_count else 0.0

    def add(self, jumps: FloatArray) -> None:
        """Move it through events.

        Parameters
        ----------
        jumps
            Jump of the mean at each, shape (E,).
        """
        self._events += jumps.size
        if self._value is None or self._size <= FEW_PIXELS or self._events > self._size:
            self._value = None
        else:
            self._value += float(jumps.sum())

    def forget(self) -> None:
        """Work it out anew: the estimates have changed otherwise."""
        self._value = None
