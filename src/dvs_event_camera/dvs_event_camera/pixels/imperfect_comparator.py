"""Comparators of imperfect pixels: mismatched, refractory, noisy; and which events are noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_event_camera.pixels.crossings import CountArray, hold_invalid
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.pixel_events import PixelEvents

_NEVER = np.iinfo(np.int64).max // 4
# Thresholds are drawn from a normal distribution, but none is smaller than this share of h.
_SMALLEST_THRESHOLD = 0.2

IndexArray = NDArray[np.int64]


class ImperfectComparator:
    """Pixels with thresholds of their own, a refractory period and shot noise.

    A pixel's reference is ``origin + n_on theta_on - n_off theta_off`` with integer numbers of
    ON and OFF events, so nothing accumulates. While a pixel is refractory its reference waits;
    afterwards it tells what it has missed, one event a period. A shot-noise event moves the
    reference as any other event does.

    The pixels that have something to say are worked on together, one event each a round.

    Parameters
    ----------
    levels
        Levels at the first sample, shape (r,).
    origin
        Levels of the first references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    imperfections
        Which of these there are.
    rng
        Draws thresholds and shot noise.
    """

    def __init__(
        self,
        levels: FloatArray,
        origin: FloatArray,
        step: float,
        imperfections: Imperfections,
        rng: np.random.Generator,
    ) -> None:
        size = levels.size
        self.invalid = 0
        self.signs: NDArray[np.int8] = np.broadcast_to(np.int8(1), size)
        self._previous, self._origin = levels.copy(), origin
        self._on, self._off = np.zeros(size, np.int32), np.zeros(size, np.int32)
        spread = imperfections.threshold_mismatch
        drawn = 1.0 + spread * rng.standard_normal((2, size)) if spread else np.ones((2, size))
        self.on_thresholds, self.off_thresholds = step * np.maximum(drawn, _SMALLEST_THRESHOLD)
        self._mean_threshold = 0.5 * (self.on_thresholds + self.off_thresholds)
        self._half_difference = 0.5 * (self.on_thresholds - self.off_thresholds)
        self._refractory_ns = as_nanoseconds(imperfections.refractory_period)
        self._ready_ns = np.full(size, -_NEVER, np.int64)
        self._shots = ShotNoise(imperfections.shot_noise_rate, size, rng)

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._on - self._off

    def start_pixels(self, pixels: IndexArray, levels: FloatArray) -> None:
        """Start pixels; see `comparators.Comparator.start_pixels`."""
        self._previous[pixels] = levels

    def begin(self, start_ns: int, duration_ns: int) -> None:
        """Start an interval; see `comparators.Comparator.begin`."""
        self._start_ns, self._duration_ns = start_ns, duration_ns
        self._expected = 0.0
        self._shots.draw(duration_ns)
        self._found: list[tuple[IndexArray, IndexArray, NDArray[np.int8], NDArray[np.bool_]]] = []

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `comparators.Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        previous = self._previous[tile]
        self.invalid += hold_invalid(levels, previous)
        reference = self._references(tile)
        upper = reference + self.on_thresholds[tile]
        lower = reference - self.off_thresholds[tile]
        news = (np.maximum(previous, levels) >= upper) | (np.minimum(previous, levels) <= lower)
        news |= self._shots.hit[tile]
        pixel = np.flatnonzero(news) + first_pixel
        if pixel.size:
            self._expect(pixel, levels[pixel - first_pixel])
            self._rounds(pixel, previous[pixel - first_pixel], levels[pixel - first_pixel])
        previous[:] = levels

    def _expect(self, pixel: IndexArray, levels: FloatArray) -> None:
        smallest = np.minimum(self.on_thresholds[pixel], self.off_thresholds[pixel])
        events = np.abs(levels - self._references(pixel)) / smallest
        if self._refractory_ns:
            events = np.minimum(events, 1 + self._duration_ns / self._refractory_ns)
        self._expected += float(np.floor(events).sum())
        farthest = np.abs(levels - self._origin[pixel]) / smallest
        require_bounded(self._expected, float(farthest.max()))

    def _references(self, pixel: IndexArray | slice) -> FloatArray:
        # on theta_on - off theta_off, written so that it depends on the sum of polarities alone
        # where the thresholds are equal: the lattice of the ideal pixel, without rounding.
        on, off = self._on[pixel], self._off[pixel]
        return np.asarray(
            self._origin[pixel]
            + (on - off) * self._mean_threshold[pixel]
            + (on + off) * self._half_difference[pixel]
        )

    def _rounds(self, pixel: IndexArray, start: FloatArray, end: FloatArray) -> None:
        clock = np.zeros(pixel.size, np.int64)
        while pixel.size:
            ready = np.maximum(clock, self._ready_ns[pixel] - self._start_ns)
            self._shots.skip_until(pixel, ready)
            when, polarity = self._next_crossing(pixel, start, end, ready)
            shot_when, shot_polarity = self._shots.next(pixel)
            is_shot = shot_when <= when
            when = np.where(is_shot, shot_when, when)
            fired = when <= self._duration_ns
            pixel, start, end = pixel[fired], start[fired], end[fired]
            clock, is_shot = when[fired], is_shot[fired]
            polarity = np.where(is_shot, shot_polarity[fired], polarity[fired]).astype(np.int8)
            self._shots.consume(pixel[is_shot])
            self._on[pixel] += polarity > 0
            self._off[pixel] += polarity < 0
            # What undoes a spurious event comes after it, if only by a nanosecond.
            pause = np.maximum(self._refractory_ns, is_shot)
            self._ready_ns[pixel] = self._start_ns + clock + pause
            self._found.append((clock, pixel, polarity, is_shot))

    def _next_crossing(
        self, pixel: IndexArray, start: FloatArray, end: FloatArray, ready: IndexArray
    ) -> tuple[IndexArray, NDArray[np.int8]]:
        """First instant from `ready` on at which a pixel is beyond a threshold, and which one."""
        reference = self._references(pixel)
        upper = reference + self.on_thresholds[pixel]
        lower = reference - self.off_thresholds[pixel]
        rise = end - start
        level = start + rise * (np.minimum(ready, self._duration_ns) / self._duration_ns)
        at_once = (level >= upper) | (level <= lower)
        up = np.where(at_once, level >= upper, end >= upper)
        beyond = at_once | (end >= upper) | (end <= lower)
        fraction = (np.where(up, upper, lower) - start) / np.where(rise == 0, 1.0, rise)
        crossing = np.ceil(np.clip(fraction, 0.0, 1.0) * self._duration_ns).astype(np.int64)
        when = np.maximum(np.where(at_once, ready, np.maximum(crossing, ready)), 1)
        when = np.where(beyond & (ready <= self._duration_ns), when, _NEVER)
        return when, np.where(up, 1, -1).astype(np.int8)

    def finish(self) -> PixelEvents:
        """Events of the interval, shot noise labelled; see `comparators.Comparator.finish`."""
        if not self._found:
            return PixelEvents.empty()
        clock, pixel, polarity, is_shot = (
            np.concatenate(column) for column in zip(*self._found, strict=True)
        )
        order = np.lexsort((polarity, pixel, clock))
        return PixelEvents(
            t=clock[order] + self._start_ns,
            pixel=pixel[order].astype(np.int32),
            polarity=polarity[order],
            sign=np.ones(order.size, np.int8),
            noise=is_shot[order].astype(np.int8),
        )


class ShotNoise:
    """Spurious events of all pixels, a Poisson process each.

    Parameters
    ----------
    rate
        Events a second of a pixel, 1/s.
    pixel_count
        Number of pixels r.
    rng
        Draws pixels, instants and polarities.
    """

    def __init__(self, rate: float, pixel_count: int, rng: np.random.Generator) -> None:
        self._rate, self._pixel_count, self._rng = rate, pixel_count, rng
        self.hit: NDArray[np.bool_] = np.zeros(pixel_count, bool)
        self._first: IndexArray = np.zeros(pixel_count + 1, np.int64)
        self._when: IndexArray = np.full(1, _NEVER)
        self._polarity: NDArray[np.int8] = np.zeros(1, np.int8)

    def draw(self, duration_ns: int) -> None:
        """Draw the events of an interval.

        Parameters
        ----------
        duration_ns
            Length of the interval, ns.
        """
        if not self._rate:
            return
        count = int(self._rng.poisson(self._rate * self._pixel_count * as_seconds(duration_ns)))
        pixel = self._rng.integers(self._pixel_count, size=count)
        when = self._rng.integers(1, duration_ns, size=count, endpoint=True)
        order = np.lexsort((when, pixel))
        sizes = np.bincount(pixel, minlength=self._pixel_count)
        self.hit = sizes > 0
        self._first[1:] = np.cumsum(sizes)
        self._next = self._first[:-1].copy()
        self._when = np.append(when[order], _NEVER)
        polarity = 2 * self._rng.integers(2, size=count, dtype=np.int8) - 1
        self._polarity = np.append(polarity, np.int8(1))

    def next(self, pixel: IndexArray) -> tuple[IndexArray, NDArray[np.int8]]:
        """Instant (`_NEVER` if none is left) and polarity of the next event of each pixel.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        """
        if not self._rate:
            return np.full(pixel.size, _NEVER), np.ones(pixel.size, np.int8)
        place = np.where(self._next[pixel] < self._first[pixel + 1], self._next[pixel], -1)
        return self._when[place], self._polarity[place]

    def skip_until(self, pixel: IndexArray, ready: IndexArray) -> None:
        """Drop events before `ready`: a refractory pixel does not see them.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        ready
            Instants, ns from the start of the interval, shape (k,).
        """
        if not self._rate:
            return
        while (early := self.next(pixel)[0] < ready).any():
            self._next[pixel[early]] += 1

    def consume(self, pixel: IndexArray) -> None:
        """Go on to the next event of each pixel.

        Parameters
        ----------
        pixel
            Pixels, shape (k,).
        """
        if self._rate:
            self._next[pixel] += 1


@dataclass(slots=True)
class NoiseLabels:
    """Which events are noise: those that light did not cause, and those that undo them.

    Every pixel has an account of polarities that noise owes: an ON event that leakage is due, an
    OFF event after a spurious ON. The next event that pays is labelled. So the polarities of the
    events that are not labelled, less what is still owed, add up to the true change of the
    luminosity within two steps. (Leakage in falling light is owed for long: it silences OFF events
    instead of making ON events.)

    Parameters
    ----------
    owed
        Polarity owed by noise, shape (r,).
    leaked
        ON events due to leakage so far, shape (r,).
    """

    owed: IndexArray
    leaked: IndexArray

    @classmethod
    def of(cls, pixel_count: int) -> NoiseLabels:
        """Nothing owed.

        Parameters
        ----------
        pixel_count
            Number of pixels r.
        """
        return cls(np.zeros(pixel_count, np.int64), np.zeros(pixel_count, np.int64))

    def label(self, events: PixelEvents, leaked: IndexArray | None) -> PixelEvents:
        """Label the events of an interval.

        Parameters
        ----------
        events
            Events with spurious ones labelled already.
        leaked
            ON events due to leakage by the end of the interval, shape (r,); None without leak.
        """
        if leaked is not None:
            self.owed += leaked - self.leaked
            self.leaked = leaked
        noise = np.zeros(len(events), np.int8) if events.noise is None else events.noise.copy()
        concerned = self.owed != 0
        concerned[events.pixel[noise > 0]] = True
        waiting = np.flatnonzero(concerned[events.pixel])
        waiting = waiting[np.argsort(events.pixel[waiting], kind='stable')]
        while waiting.size:
            # The first event of every pixel that is left.
            pixel = events.pixel[waiting]
            first = np.r_[True, pixel[1:] != pixel[:-1]]
            self._pay(events, noise, waiting[first])
            waiting = waiting[~first]
        return events.labelled(noise)

    def _pay(self, events: PixelEvents, noise: NDArray[np.int8], index: IndexArray) -> None:
        pixel, polarity = events.pixel[index], events.polarity[index].astype(np.int64)
        spurious = noise[index] > 0
        pays = ~spurious & (self.owed[pixel] * polarity > 0)
        noise[index[pays]] = 1
        self.owed[pixel[spurious | pays]] -= polarity[spurious | pays]
