"""The pixels of an event camera: samples of luminosity in, events out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvs_event_camera.comparators import Comparator, ideal_comparator
from dvs_event_camera.photoreceptor import LogPhotoreceptor, Photoreceptor
from dvs_event_camera.pixel_events import PixelEvents
from dvs_event_camera.references import (
    initial_references,
    reference_levels,
    require_silent_start,
    threshold_step,
)
from dvs_event_camera.signed_crossings import SignedComparator
from dvs_interfaces.errors import ParameterError
from dvs_interfaces.model import FloatArray, ReferenceBounds

# Pixels worked on at a time, so that their levels stay in the processor's cache.
_TILE = 16384


class PixelArray:
    """r pixels that fire when the log luminosity has moved by h since their last event (eq. 3).

    A pixel's reference is ``q = s q0 b^(N h)`` with the **integer** N, the sum of its polarities:
    nothing accumulates, so sensor and estimator agree bit for bit for ever. Events of an interval
    are those in ``(t_prev, t_now]``, stamped to the nanosecond at which the interpolated level has
    crossed the threshold.

    Parameters
    ----------
    event_threshold
        h > 0, in logarithms to the base b.
    log_base
        b > 1.
    photoreceptor
        How luminosity becomes a level; `LogPhotoreceptor()` is the paper's.
    bounds
        m and M of every pixel; None takes them around the first sample.
    reference_uncertainty
        dy of the bounds around the first sample, in the unit of luminosity (unused with `bounds`).
    initial_reference
        `luminosity`, `lower`, `upper` or `random`: where in [m, M] the references start.
    seed
        Of the random references.
    backend
        `numba`, `numpy` or `auto` (numba where it is installed and pays): same results.

    Raises
    ------
    ParameterError
        If h, b, the uncertainty or the kind of reference is out of range.
    """

    def __init__(
        self,
        *,
        event_threshold: float,
        log_base: float = math.e,
        photoreceptor: Photoreceptor | None = None,
        bounds: ReferenceBounds | None = None,
        reference_uncertainty: float = 0.0,
        initial_reference: str = 'luminosity',
        seed: int = 0,
        backend: str = 'auto',
    ) -> None:
        self._step = threshold_step(event_threshold, log_base)
        self._receptor: Photoreceptor = photoreceptor or LogPhotoreceptor()
        self._explicit_bounds = bounds
        self._uncertainty = reference_uncertainty
        self._initial_reference = initial_reference
        self._seed = seed
        self._backend = backend
        self._stamp_ns: int | None = None
        self._comparator: Comparator

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last sample, ns; None before the first."""
        return self._stamp_ns

    @property
    def counts(self) -> NDArray[np.int32]:
        """N, the sum of polarities since the first sample, shape (r,); a copy."""
        return self._comparator.counts.copy()

    @property
    def signs(self) -> NDArray[np.int8]:
        """Sign s of every reference, shape (r,); a copy. All +1 but with `signed_log`."""
        return self._comparator.signs.copy()

    @property
    def bounds(self) -> ReferenceBounds:
        """Bounds m and M that were checked at the first sample."""
        return self._bounds

    @property
    def reference_levels(self) -> FloatArray:
        """Level of every reference (log |q|), shape (r,)."""
        return self._origin + self._comparator.counts * self._step

    @property
    def invalid_samples(self) -> int:
        """Pixel samples so far without meaning (y <= 0, NaN, infinite), at which a pixel held."""
        return self._comparator.invalid

    def update(self, stamp_ns: int, luminosity: ArrayLike) -> PixelEvents:
        """Take the next sample and return the events since the last one.

        The first sample starts the array: it checks (A1), sets the references and emits nothing.
        Where a later sample has no meaning to the photoreceptor the pixel keeps its last value.

        Parameters
        ----------
        stamp_ns
            Time of the sample, ns, later than the last one.
        luminosity
            y, shape (r,) (or any shape with r entries, row-major).

        Returns
        -------
        PixelEvents
            Events in ``(last stamp, stamp_ns]``, sorted by (t, pixel).

        Raises
        ------
        ParameterError
            If the first sample violates (A1), or a later one is not later or has another size.
        """
        sample = np.asarray(luminosity).reshape(-1)
        if self._stamp_ns is None:
            self._start(sample.astype(np.float64))
            self._stamp_ns = stamp_ns
            return PixelEvents.empty()
        if sample.size != self._origin.size:
            raise ParameterError(
                'luminosity', sample.size, f'must have {self._origin.size} entries, as before'
            )
        duration_ns = stamp_ns - self._stamp_ns
        if duration_ns <= 0:
            raise ParameterError(
                'stamp_ns', stamp_ns, f'must be later than the last, {self._stamp_ns}'
            )
        self._comparator.begin(self._stamp_ns, duration_ns)
        for first in range(0, sample.size, _TILE):
            self._comparator.fire(self._tile_levels(sample[first : first + _TILE]), first)
        self._stamp_ns = stamp_ns
        return self._comparator.finish()

    def _start(self, sample: FloatArray) -> None:
        sample = self._receptor.floored(sample)
        bounds = self._explicit_bounds or ReferenceBounds.around(sample, self._uncertainty)
        require_silent_start(bounds, sample, self._receptor, self._step)
        references = initial_references(self._initial_reference, bounds, sample, self._seed)
        self._bounds = bounds
        self._origin = reference_levels(self._receptor, references)
        band = self._receptor.dead_band
        if band is not None:
            self._comparator = SignedComparator(sample, self._origin, self._step, band)
        else:
            self._comparator = ideal_comparator(
                self._backend, self._receptor.levels(sample), self._origin, self._step
            )
        self._scratch = np.empty(min(_TILE, sample.size))

    def _tile_levels(self, tile: NDArray[np.generic]) -> FloatArray:
        scratch = self._scratch[: tile.size]
        luminosity = np.asarray(tile, dtype=np.float64)
        if self._receptor.dead_band is not None:
            return luminosity
        return self._receptor.levels(luminosity, out=scratch)
