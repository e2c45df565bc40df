"""The events of a packet pixel by pixel, by NumPy; or the compiled code that takes its place."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Events from which on compiled code pays: importing numba takes a second.
WORTH_COMPILING = 4096


class PixelTurns:
    """Events sorted by pixel, in the order of time within each, and counted.

    Parameters
    ----------
    pixels
        Pixel of every event in the order of time, shape (E,), E > 0.
    polarities
        +1 or -1, shape (E,).
    counts
        N of every pixel before, shape (r,).

    Attributes
    ----------
    order
        Which event stands where, shape (E,).
    pixel
        Pixels in this order, shape (E,).
    counts
        N of the pixel after each, shape (E,).
    is_first
        Whether it is the first one of its pixel, shape (E,).
    is_last
        Whether it is the last one, shape (E,).
    """

    def __init__(
        self,
        pixels: NDArray[np.intp],
        polarities: NDArray[np.int8],
        counts: NDArray[np.int64],
    ) -> None:
        self.order = np.argsort(pixels, kind='stable')
        self.pixel = pixels[self.order]
        self.is_first = np.ones(len(pixels), dtype=bool)
        self.is_first[1:] = self.pixel[1:] != self.pixel[:-1]
        self.is_last = np.append(self.is_first[1:], True)
        running = np.cumsum(polarities[self.order], dtype=np.int64)
        group = np.cumsum(self.is_first) - 1
        before_group = np.concatenate(([0], running))[np.flatnonzero(self.is_first)]
        self.counts = counts[self.pixel] + running - before_group[group]


def kernels_for(events: int) -> Any | None:
    """Module `interval_kernels` where it is worth its start, None where NumPy is to do it.

    Parameters
    ----------
    events
        Number of events.
    """
    return _kernels() if events >= WORTH_COMPILING else None


@cache
def _kernels() -> Any | None:
    try:
        return importlib.import_module('dvs_hinf_controller.running.interval_kernels')
    except (ImportError, RuntimeError, ValueError):
        # Without numba or a place for its cache, or with NUMBA_NUM_THREADS=0.
        return None
