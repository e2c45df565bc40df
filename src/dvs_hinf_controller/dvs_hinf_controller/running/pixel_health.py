"""Which pixels are used: those that absolute measurements do not contradict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dvs_hinf_controller.problem import unmasked

# A contradiction outweighs this many confirmations, and so many of them mask a pixel.
_CONTRADICTION = 8
_MASKING = 4 * _CONTRADICTION
_WORST = 8 * _CONTRADICTION


class PixelHealth:
    """Masks a pixel whose anchors contradict its events again and again.

    A contradiction now and then is an event of noise or a loss that was not reported; a hot pixel,
    whose reference leaks faster than `leak_uncertainty` allows, meets one at almost every anchor.
    A masked pixel comes back when its anchors have agreed with it for long enough.

    Parameters
    ----------
    pixel_count
        r.
    masked
        Row-major numbers of pixels that are known to be unfit and stay masked.

    Raises
    ------
    ParameterError
        If a number is not that of a pixel, or no pixel is left.
    """

    def __init__(self, pixel_count: int, masked: Sequence[int] = ()) -> None:
        self._given = ~unmasked(pixel_count, masked)
        self._suspicion = np.zeros(pixel_count, np.int16)
        self._suspect = np.zeros(pixel_count, bool)
        self.healthy: NDArray[np.bool_] = ~self._given
        self._masked = self._given

    def read_masked(self) -> tuple[int, ...]:
        """Row-major numbers of the pixels that were masked at any time since the last reading."""
        masked, self._masked = self._masked, ~self.healthy
        return tuple(np.flatnonzero(masked).tolist())

    def note(self, confirmed: NDArray[np.bool_], contradicted: NDArray[np.bool_]) -> bool:
        """Take the outcome of an anchor; return whether another set of pixels is healthy now.

        Where nearly all pixels are suspect it is not they that are unfit, and none is masked.

        Parameters
        ----------
        confirmed
            Pixels whose reference agreed with the anchor, shape (r,).
        contradicted
            Pixels whose reference did not, shape (r,).
        """
        if not contradicted.any() and not self._suspicion.any():
            return False
        self._suspicion += _CONTRADICTION * contradicted.astype(np.int16)
        self._suspicion -= confirmed
        np.clip(self._suspicion, 0, _WORST, out=self._suspicion)
        self._suspect |= self._suspicion >= _MASKING
        self._suspect &= self._suspicion > 0
        healthy = ~(self._given | self._suspect)
        if not healthy.any():
            healthy = ~self._given
        changed = not np.array_equal(healthy, self.healthy)
        self.healthy = healthy
        self._masked = self._masked | ~healthy
        return changed
