"""What works on the frames of a pixel array: whole frames in, events of the interval out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.comparators import Comparator, NumpyComparator
from dvs_event_camera.pixels.crossings import CountArray
from dvs_event_camera.pixels.level_stages import LevelStage
from dvs_event_camera.pixels.photoreceptor import Photoreceptor
from dvs_event_camera.pixels.pixel_events import PixelEvents

# Pixels worked on at a time, so that their levels stay in the processor's cache.
TILE = 32768


class PixelEngine(Protocol):
    """What a pixel array asks of what computes its events."""

    @property
    def signs(self) -> NDArray[np.int8]:
        """Sign of every reference, shape (r,)."""

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""

    @property
    def invalid(self) -> int:
        """Pixel samples without meaning so far."""

    def distances(self) -> FloatArray:
        """How far the last levels lie above their references, shape (r,); of ideal pixels only."""

    def start_pixels(self, pixels: NDArray[np.int64], luminosity: NDArray[np.generic]) -> None:
        """Start pixels that had no light before, at rest on their references.

        Parameters
        ----------
        pixels
            Pixels, shape (k,); the array has set their first references already.
        luminosity
            Their luminosities, shape (k,).
        """

    def expose(
        self, luminosity: NDArray[np.generic], start_ns: int, duration_ns: int, elapsed_ns: int
    ) -> PixelEvents:
        """Events of an interval, in order.

        Parameters
        ----------
        luminosity
            Sample at the end of the interval, shape (r,).
        start_ns
            Start of the interval, ns.
        duration_ns
            Its length, ns.
        elapsed_ns
            Time from the first sample to the end of the interval, ns.

        Raises
        ------
        EventFlood
            If the interval has too many events; the engine is of no use any more.
        """


class NumpyPixels:
    """Comparators in NumPy, tile by tile: the reference for what is compiled.

    Parameters
    ----------
    comparator
        Compares levels, or luminosities where the photoreceptor has a dead band.
    photoreceptor
        How luminosity becomes a level.
    stages
        What happens to a level before it is compared.
    """

    def __init__(
        self, comparator: Comparator, photoreceptor: Photoreceptor, stages: Sequence[LevelStage]
    ) -> None:
        self.comparator = comparator
        self.photoreceptor, self.stages = photoreceptor, stages
        self._scratch = np.empty(min(TILE, comparator.counts.size))

    @property
    def signs(self) -> NDArray[np.int8]:
        """Sign of every reference, shape (r,)."""
        return self.comparator.signs

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self.comparator.counts

    @property
    def invalid(self) -> int:
        """Pixel samples without meaning so far."""
        return self.comparator.invalid

    def distances(self) -> FloatArray:
        """How far levels lie above references; see `PixelEngine.distances`."""
        assert isinstance(self.comparator, NumpyComparator)
        return self.comparator.distances()

    def start_pixels(self, pixels: NDArray[np.int64], luminosity: NDArray[np.generic]) -> None:
        """Start pixels; see `PixelEngine.start_pixels`."""
        light = luminosity.astype(np.float64)
        self.comparator.start_pixels(pixels, light if self._takes_light else self._levels(light))

    def expose(
        self, luminosity: NDArray[np.generic], start_ns: int, duration_ns: int, elapsed_ns: int
    ) -> PixelEvents:
        """Events of an interval; see `PixelEngine.expose`."""
        self.comparator.begin(start_ns, duration_ns, luminosity)
        for first in range(0, luminosity.size, TILE):
            tile = luminosity[first : first + TILE]
            levels = self._levels(np.asarray(tile, dtype=np.float64))
            for stage in self.stages:
                stage.apply(levels, first, elapsed_ns, duration_ns)
            self.comparator.fire(levels, first)
        return self.comparator.finish()

    @property
    def _takes_light(self) -> bool:
        return self.photoreceptor.dead_band is not None

    def _levels(self, light: FloatArray) -> FloatArray:
        if self._takes_light:
            return light
        return self.photoreceptor.levels(light, out=self._scratch[: light.size])
