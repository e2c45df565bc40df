"""Luminosities at which a small pixel array fires no event.

Most frames of a small array hold no event, and NumPy's fixed costs exceed the work: two
comparisons a pixel find such a frame without a logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dvs_common.arrays import FEW_FLOATS, FloatArray
from dvs_event_camera.pixels.comparators import NumpyComparator
from dvs_event_camera.pixels.engine import NumpyPixels, PixelEngine
from dvs_event_camera.pixels.photoreceptor import LogPhotoreceptor, Photoreceptor

# Keeps the band away from the thresholds by far more than a logarithm is rounded.
_MARGIN = 1e-9


class SilentBand:
    """Between its borders no pixel is near a threshold.

    A silent frame of nine pixels takes 1/4.9 of the time that the comparators take
    (`cycle_silent_band_gain` of ``scripts/bench.sh cycle``).

    Parameters
    ----------
    reference_levels
        Natural logarithms of the references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    """

    __slots__ = ('_borders',)

    def __init__(self, reference_levels: FloatArray, step: float) -> None:
        with np.errstate(over='ignore'):
            lower = np.exp(reference_levels - step + _MARGIN)
            upper = np.exp(reference_levels + step - _MARGIN)
        # A logarithm that overflows on its way back is no border.
        upper[upper == math.inf] = 0.0
        self._borders = list(zip(lower.tolist(), upper.tolist(), strict=True))

    def holds(self, luminosity: Sequence[float]) -> bool:
        """Whether no pixel fires at these luminosities; NaN is never silent.

        Parameters
        ----------
        luminosity
            y, r entries.
        """
        for y, (lower, upper) in zip(luminosity, self._borders, strict=True):
            if not lower < y < upper:
                return False
        return True


def silent_band_of(
    engine: PixelEngine, receptor: Photoreceptor, reference_levels: FloatArray, step: float
) -> SilentBand | None:
    """Where pixels are silent; None if they are many or not the ideal ones.

    Parameters
    ----------
    engine
        The pixels.
    receptor
        Their photoreceptor.
    reference_levels
        Natural logarithms of the references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    """
    is_ideal = (
        isinstance(engine, NumpyPixels)
        and type(engine.comparator) is NumpyComparator
        and isinstance(receptor, LogPhotoreceptor)
    )
    if not is_ideal or reference_levels.size > FEW_FLOATS:
        return None
    return SilentBand(reference_levels, step)
