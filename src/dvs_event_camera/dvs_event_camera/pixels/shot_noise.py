"""Shot noise: spurious events of all pixels, a Poisson process each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds

NEVER = int(np.iinfo(np.int64).max // 4)
# Share of the rate that is left in bright light (v2e, `SHOT_NOISE_INTEN_FACTOR`).
_BRIGHT_SHARE = 0.25

IndexArray = NDArray[np.int64]


class ShotNoise:
    """Spurious events of an interval, sorted by pixel and time; the last entry is no event.

    Parameters
    ----------
    rate
        Events a second of a pixel without light, 1/s.
    bright
        Luminosity at which a quarter of the rate is left; on the way there the rate falls
        linearly. 0: the same rate everywhere.
    pixel_count
        Number of pixels r.
    rng
        Draws pixels, instants and polarities.
    """

    def __init__(
        self, rate: float, bright: float, pixel_count: int, rng: np.random.Generator
    ) -> None:
        self._rate, self._bright = rate, bright
        self._pixel_count, self._rng = pixel_count, rng
        self.pixel: IndexArray = np.array([pixel_count])
        self.when: IndexArray = np.array([NEVER])
        self.polarity: NDArray[np.int8] = np.ones(1, np.int8)

    def draw(self, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Draw the events of an interval.

        Parameters
        ----------
        duration_ns
            Length of the interval, ns.
        luminosity
            Sample at its end, shape (r,).
        """
        if not self._rate:
            return
        rng = self._rng
        count = int(rng.poisson(self._rate * self._pixel_count * as_seconds(duration_ns)))
        pixel = rng.integers(self._pixel_count, size=count)
        when = rng.integers(1, duration_ns, size=count, endpoint=True)
        polarity = 2 * rng.integers(2, size=count, dtype=np.int8) - 1
        order = np.lexsort((when, pixel))
        if self._bright:
            order = order[rng.random(count) < self._share(luminosity[pixel[order]])]
        self.pixel = np.append(pixel[order], self._pixel_count)
        self.when = np.append(when[order], NEVER)
        self.polarity = np.append(polarity[order], np.int8(1))

    def _share(self, luminosity: NDArray[Any]) -> NDArray[np.float64]:
        brightness = np.nan_to_num(luminosity.astype(np.float64)) / self._bright
        return np.asarray(1.0 - (1.0 - _BRIGHT_SHARE) * np.clip(brightness, 0.0, 1.0))


class ShotQueue:
    """The shot noise of an interval, pixel by pixel.

    Parameters
    ----------
    shots
        Shot noise, drawn.
    pixel_count
        Number of pixels r.
    """

    def __init__(self, shots: ShotNoise, pixel_count: int) -> None:
        self._shots = shots
        sizes = np.bincount(shots.pixel[:-1], minlength=pixel_count)
        self.hit: NDArray[np.bool_] = sizes > 0
        self._end = np.cumsum(sizes)
        self._next = self._end - sizes

    def next(self, pixel: IndexArray) -> tuple[IndexArray, NDArray[np.int8]]:
        """Instant (`NEVER` if none is left) and polarity of the next event of each pixel.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        """
        place = np.where(self._next[pixel] < self._end[pixel], self._next[pixel], -1)
        return self._shots.when[place], self._shots.polarity[place]

    def skip_until(self, pixel: IndexArray, ready: IndexArray) -> None:
        """Drop events before `ready`: a refractory pixel does not see them.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        ready
            Instants, ns from the start of the interval, shape (k,).
        """
        while (early := self.next(pixel)[0] < ready).any():
            self._next[pixel[early]] += 1

    def consume(self, pixel: IndexArray) -> None:
        """Go on to the next event of each pixel.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        """
        self._next[pixel] += 1
