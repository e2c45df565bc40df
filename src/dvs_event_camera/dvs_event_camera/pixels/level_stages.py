"""What happens to a level between photoreceptor and comparator: low-pass, leak, dead pixels."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import NANOSECONDS, as_seconds
from dvs_event_camera.pixels.imperfections import Imperfections

_DARKEST_CUTOFF = 0.1


class LevelStage(Protocol):
    """Changes the levels of a tile in place."""

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray, elapsed_ns: int) -> None:
        """Start pixels that had no light before.

        Parameters
        ----------
        pixels
            Pixels, shape (k,).
        levels
            Their first levels, shape (k,).
        elapsed_ns
            Time since the first sample of the array, ns.
        """

    def apply(
        self, levels: FloatArray, first_pixel: int, elapsed_ns: int, duration_ns: int
    ) -> None:
        """Change the levels of a tile at the end of an interval.

        Parameters
        ----------
        levels
            Levels, shape (k,); NaN or infinite where the luminosity has no meaning, and left so.
        first_pixel
            Index of the tile's first pixel.
        elapsed_ns
            Time since the first sample, ns.
        duration_ns
            Time since the last sample, ns.
        """


class LowPass:
    """First-order low-pass, exact for a level that is linear in time between samples.

    Parameters
    ----------
    levels
        Levels at the first sample, at which the filter rests, shape (r,).
    cutoff_frequency
        Corner, Hz, > 0.
    cutoff_luminosity
        Luminosity from which on the corner is reached, 0 for one corner everywhere.
    kernels
        Module `pixel_kernels`, or None.
    """

    def __init__(
        self,
        levels: FloatArray,
        cutoff_frequency: float,
        cutoff_luminosity: float,
        kernels: Any = None,
    ) -> None:
        self._kernels = kernels
        self._input = levels.copy()
        self._output = levels.copy()
        self._rate = 2 * math.pi * cutoff_frequency
        self._full = cutoff_luminosity

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray, elapsed_ns: int) -> None:
        """Rest at the first level; see `LevelStage.start_pixels`."""
        self._input[pixels] = self._output[pixels] = levels

    def apply(
        self, levels: FloatArray, first_pixel: int, elapsed_ns: int, duration_ns: int
    ) -> None:
        """Filter; see `LevelStage.apply`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        before, output = self._input[tile], self._output[tile]
        if self._kernels is not None and not self._full:
            advance = self._rate * as_seconds(duration_ns)
            self._kernels.low_pass(levels, before, output, advance, float(np.exp(-advance)))
            return
        meaningful = np.isfinite(levels)
        now = np.where(meaningful, levels, before)
        duration = as_seconds(duration_ns)
        rate: FloatArray | float = self._rate
        if self._full > 0:
            rate = rate * np.clip(np.exp(now) / self._full, _DARKEST_CUTOFF, 1.0)
        # y' = rate (u - y) with u linear: y = u - lag + (y0 - u0 + lag) exp(-rate t).
        lag = (now - before) / (rate * duration)
        output[:] = now - lag + (output - before + lag) * np.exp(-rate * duration)
        before[:] = now
        np.copyto(levels, output, where=meaningful)


class Leak:
    """References that leak, so that constant light makes ON events at a steady rate.

    Parameters
    ----------
    rates
        Events a second of every pixel, 1/s, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    rng
        Draws the phase of every pixel, uniform in [0, 1) events.
    kernels
        Module `pixel_kernels`, or None.
    """

    def __init__(
        self, rates: FloatArray, step: float, rng: np.random.Generator, kernels: Any = None
    ) -> None:
        self._kernels = kernels
        self.rates = rates
        self._step = step
        self.phase = np.where(rates > 0, rng.random(rates.size), 0.0)

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray, elapsed_ns: int) -> None:
        """Begin to leak; see `LevelStage.start_pixels`."""
        self.phase[pixels] -= self.rates[pixels] * as_seconds(elapsed_ns)

    def apply(
        self, levels: FloatArray, first_pixel: int, elapsed_ns: int, duration_ns: int
    ) -> None:
        """Leak; see `LevelStage.apply`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        phase, rates, seconds = self.phase[tile], self.rates[tile], as_seconds(elapsed_ns)
        if self._kernels is not None:
            self._kernels.leak(levels, phase, rates, seconds, self._step)
            return
        levels += self._step * (phase + rates * seconds)

    def ahead_ns(self) -> NDArray[np.int64]:
        """Time by which each pixel has leaked at the first sample already, ns, shape (r,)."""
        leaks = self.rates > 0
        seconds = np.divide(self.phase, self.rates, out=np.zeros(leaks.size), where=leaks)
        return (seconds * NANOSECONDS).astype(np.int64)

    def due(self, elapsed_ns: int) -> NDArray[np.int64]:
        """ON events that leakage alone has caused since the first sample, shape (r,).

        Parameters
        ----------
        elapsed_ns
            Time since the first sample, ns.
        """
        # The margin is for a pixel in constant light, whose event comes at the very instant.
        leaked = self.phase + self.rates * as_seconds(elapsed_ns)
        return np.floor(leaked + 1e-6).astype(np.int64)


class DeadPixels:
    """Pixels whose level never changes.

    Parameters
    ----------
    levels
        Levels at the first sample, shape (r,).
    dead
        Indices of the dead pixels, sorted.
    """

    def __init__(self, levels: FloatArray, dead: NDArray[np.int64]) -> None:
        self.dead = dead
        self.frozen = levels[dead]

    def start_pixels(self, pixels: NDArray[np.int64], levels: FloatArray, elapsed_ns: int) -> None:
        """Freeze at the first level; see `LevelStage.start_pixels`."""
        place = np.searchsorted(self.dead, pixels)
        known = place < self.dead.size
        known[known] = self.dead[place[known]] == pixels[known]
        self.frozen[place[known]] = levels[known]

    def apply(
        self, levels: FloatArray, first_pixel: int, elapsed_ns: int, duration_ns: int
    ) -> None:
        """Freeze; see `LevelStage.apply`."""
        low, high = np.searchsorted(self.dead, [first_pixel, first_pixel + levels.size])
        levels[self.dead[low:high] - first_pixel] = self.frozen[low:high]


def level_stages(
    imperfections: Imperfections,
    levels: FloatArray,
    step: float,
    rng: np.random.Generator,
    kernels: Any = None,
) -> list[LevelStage]:
    """Stages that `imperfections` ask for, in the order of the signal.

    Parameters
    ----------
    imperfections
        What is on.
    levels
        Levels at the first sample, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    rng
        Draws hot and dead pixels and the phases of the leak.
    kernels
        Module `pixel_kernels`, or None.
    """
    stages: list[LevelStage] = []
    wanted = imperfections
    if wanted.cutoff_frequency:
        corner, full = wanted.cutoff_frequency, wanted.cutoff_luminosity
        stages.append(LowPass(levels, corner, full, kernels))
    shuffled = rng.permutation(levels.size)
    hot_count = round(wanted.hot_pixel_fraction * levels.size)
    dead_count = round(wanted.dead_pixel_fraction * levels.size)
    hot, dead = shuffled[:hot_count], np.sort(shuffled[levels.size - dead_count :])
    if wanted.leak_rate or hot_count:
        rates = np.full(levels.size, wanted.leak_rate)
        rates[hot] = wanted.hot_pixel_rate
        rates[dead] = 0.0
        stages.append(Leak(rates, step, rng, kernels))
    if dead_count:
        stages.append(DeadPixels(levels, dead))
    return stages
