"""Comparators of imperfect pixels: mismatched, refractory, noisy, with a physical reset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.crossings import CountArray, hold_invalid
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.pixels.pixel_state import ImperfectState
from dvs_event_camera.pixels.shot_noise import NEVER, IndexArray, ShotQueue


class ImperfectComparator:
    """Pixels with thresholds of their own, a refractory period, shot noise or a physical reset.

    While a pixel is refractory its reference waits. Afterwards a pixel with `reset: ladder` fires
    for what it has missed, one event a period; one with `reset: level` fires once and goes on
    from the present level. A shot-noise event moves the reference as any other event does.

    The pixels that are to fire are worked on together, one event each a round.

    Parameters
    ----------
    levels
        Levels at the first sample, shape (r,).
    state
        The pixels.
    """

    def __init__(self, levels: FloatArray, state: ImperfectState) -> None:
        self.invalid = 0
        self.signs: NDArray[np.int8] = np.broadcast_to(np.int8(1), levels.size)
        self.state = state
        self.previous = levels.copy()

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self.state.counts

    def start_pixels(self, pixels: IndexArray, levels: FloatArray) -> None:
        """Start pixels; see `comparators.Comparator.start_pixels`."""
        self.previous[pixels] = levels
        self.state.start_pixels(pixels)

    def begin(self, start_ns: int, duration_ns: int, luminosity: NDArray[np.generic]) -> None:
        """Start an interval; see `comparators.Comparator.begin`."""
        self._start_ns, self._duration_ns = start_ns, duration_ns
        self._expected = 0.0
        self.state.shots.draw(duration_ns, luminosity)
        self._shots = ShotQueue(self.state.shots, self.previous.size)
        self._found: list[tuple[IndexArray, IndexArray, NDArray[np.int8], NDArray[np.bool_]]] = []

    def fire(self, levels: FloatArray, first_pixel: int) -> None:
        """Compare a tile; see `comparators.Comparator.fire`."""
        tile = slice(first_pixel, first_pixel + levels.size)
        previous = self.previous[tile]
        self.invalid += hold_invalid(levels, previous)
        reference = self.state.references(tile)
        upper = reference + self.state.on_thresholds[tile]
        lower = reference - self.state.off_thresholds[tile]
        news = (np.maximum(previous, levels) >= upper) | (np.minimum(previous, levels) <= lower)
        news |= self._shots.hit[tile]
        pixel = np.flatnonzero(news) + first_pixel
        if pixel.size:
            self._expect(pixel, levels[pixel - first_pixel])
            self._rounds(pixel, previous[pixel - first_pixel], levels[pixel - first_pixel])
        previous[:] = levels

    def _expect(self, pixel: IndexArray, levels: FloatArray) -> None:
        state = self.state
        smallest = np.minimum(state.on_thresholds[pixel], state.off_thresholds[pixel])
        events = np.abs(levels - state.references(pixel)) / smallest
        if state.refractory_ns:
            events = np.minimum(events, 1 + self._duration_ns / state.refractory_ns)
        self._expected += float(np.floor(events).sum())
        require_bounded(self._expected)

    def _rounds(self, pixel: IndexArray, start: FloatArray, end: FloatArray) -> None:
        state = self.state
        clock = np.zeros(pixel.size, np.int64)
        while pixel.size:
            ready = np.maximum(clock, state.ready_ns[pixel] - self._start_ns)
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
            state.on[pixel] += polarity > 0
            state.off[pixel] += polarity < 0
            if not state.ladder:
                state.present[pixel] = start + (end - start) * (clock / self._duration_ns)
            # What undoes a spurious event comes after it, if only by a nanosecond.
            pause = np.maximum(state.refractory_ns, is_shot)
            state.ready_ns[pixel] = self._start_ns + clock + pause
            self._found.append((clock, pixel, polarity, is_shot))

    def _next_crossing(
        self, pixel: IndexArray, start: FloatArray, end: FloatArray, ready: IndexArray
    ) -> tuple[IndexArray, NDArray[np.int8]]:
        """First instant from `ready` on at which a pixel is beyond a threshold, and which one."""
        reference = self.state.references(pixel)
        upper = reference + self.state.on_thresholds[pixel]
        lower = reference - self.state.off_thresholds[pixel]
        rise = end - start
        level = start + rise * (np.minimum(ready, self._duration_ns) / self._duration_ns)
        at_once = (level >= upper) | (level <= lower)
        up = np.where(at_once, level >= upper, end >= upper)
        beyond = at_once | (end >= upper) | (end <= lower)
        fraction = (np.where(up, upper, lower) - start) / np.where(rise == 0, 1.0, rise)
        crossing = np.ceil(np.clip(fraction, 0.0, 1.0) * self._duration_ns).astype(np.int64)
        when = np.maximum(np.where(at_once, ready, np.maximum(crossing, ready)), 1)
        when = np.where(beyond & (ready <= self._duration_ns), when, NEVER)
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
