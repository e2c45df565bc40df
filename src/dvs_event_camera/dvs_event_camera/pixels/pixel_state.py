"""State of imperfect pixels: thresholds and references of their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds
from dvs_event_camera.pixels.crossings import CountArray
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.shot_noise import NEVER, ShotNoise

# Thresholds are drawn from a normal distribution, but none is smaller than this share of h.
_SMALLEST_THRESHOLD = 0.2

_Pixels = NDArray[np.int64] | slice


class ImperfectState:
    """What imperfect pixels remember from one interval to the next.

    With `reset: ladder` a pixel's reference is ``origin + n_on theta_on - n_off theta_off`` with
    integer numbers of ON and OFF events, so nothing accumulates. With `reset: level` it is the
    level at the pixel's last event.

    Parameters
    ----------
    origin
        Levels of the first references, shape (r,).
    on_step, off_step
        Thresholds as changes of the level, ``h ln b``.
    imperfections
        Which imperfections there are.
    rng
        Draws thresholds and shot noise.
    """

    def __init__(
        self,
        origin: FloatArray,
        on_step: float,
        off_step: float,
        imperfections: Imperfections,
        rng: np.random.Generator,
    ) -> None:
        size = origin.size
        self.origin = origin
        self.ladder = imperfections.reset == 'ladder'
        self.present = origin.copy()
        self.on, self.off = np.zeros(size, np.int32), np.zeros(size, np.int32)
        spread = imperfections.threshold_mismatch
        drawn = 1.0 + spread * rng.standard_normal((2, size)) if spread else np.ones((2, size))
        drawn = np.maximum(drawn, _SMALLEST_THRESHOLD)
        self.on_thresholds, self.off_thresholds = on_step * drawn[0], off_step * drawn[1]
        self.own_thresholds = spread > 0
        # The distance of both thresholds from the reference, where it is the same everywhere.
        self.half_width = None if spread or on_step != off_step else on_step
        self.refractory_ns = as_nanoseconds(imperfections.refractory_period)
        self.ready_ns = np.full(size, -NEVER, np.int64)
        self.shots = ShotNoise(
            imperfections.shot_noise_rate, imperfections.shot_noise_luminosity, size, rng
        )

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self.on - self.off

    def start_pixels(self, pixels: NDArray[np.int64]) -> None:
        """Take new first references.

        Parameters
        ----------
        pixels
            Pixels that start, shape (k,).
        """
        self.present[pixels] = self.origin[pixels]

    def references(self, pixels: _Pixels) -> FloatArray:
        """Levels of the references.

        Parameters
        ----------
        pixels
            Which pixels.
        """
        if not self.ladder:
            return np.asarray(self.present[pixels])
        # on theta_on - off theta_off, written so that it depends on the sum of polarities alone
        # where the thresholds are equal: the lattice of the ideal pixel, without rounding.
        on, off = self.on[pixels], self.off[pixels]
        up, down = self.on_thresholds[pixels], self.off_thresholds[pixels]
        return np.asarray(
            self.origin[pixels]
            + (on - off) * (0.5 * (up + down))
            + (on + off) * (0.5 * (up - down))
        )
