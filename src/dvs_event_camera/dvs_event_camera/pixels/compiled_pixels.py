"""Compiled pixels: one pass finds the pixels with news, and only these are worked on.

Most pixels of most frames are silent. Each has a band of silent values (`bands`), and a pass over
the frame compares luminosities with it, without a logarithm. The logarithms of the pixels outside
their bands are NumPy's, so that the events are those of `NumpyPixels`. An immutable frame is kept
as it is for the next interval, any other is copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.bands import bands_for
from dvs_event_camera.pixels.crossings import CountArray
from dvs_event_camera.pixels.engine import TILE
from dvs_event_camera.pixels.event_flood import require_bounded
from dvs_event_camera.pixels.firing import ActivePixels, Firing, Interval
from dvs_event_camera.pixels.level_stages import LevelStage
from dvs_event_camera.pixels.photoreceptor import InvertiblePhotoreceptor, Photoreceptor
from dvs_event_camera.pixels.pixel_events import KEY_BITS, PixelEvents

# Pixels worked on at a time, so that what is computed of them stays in the processor's cache.
_BLOCK = 2**18
# Events up to which counting digits takes longer than comparing.
_FEW = 256
_UNSIGNED = ('u1', 'u2')
_FLOATS = ('f4', 'f8')


class _Strip:
    """Some rows of the array, and what one thread needs to work on them."""

    __slots__ = ('found', 'held', 'keys', 'mask', 'pixels', 'used')

    def __init__(self, first: int, last: int, tile: int) -> None:
        self.pixels = slice(first, last)
        self.mask = np.zeros(tile + 8, np.uint8)
        self.found = np.zeros(min(last - first, _BLOCK), np.int32)
        self.keys = np.empty(1024, np.int64)
        self.used = 0
        self.held: list[NDArray[np.int32]] = []


class CompiledPixels:
    """The same events as `NumpyPixels`, bit for bit.

    Parameters
    ----------
    luminosity
        First sample, shape (r,).
    photoreceptor
        How luminosity becomes a level.
    origin
        Levels of the first references, shape (r,).
    firing
        What a pixel does that has news.
    stages
        What happens to a level before it is compared.
    kernels
        Module `pixel_kernels`.
    threads
        Threads that share the pixels.
    levels
        Levels to start from instead of those of `luminosity`, shape (r,).
    """

    def __init__(
        self,
        luminosity: NDArray[np.generic],
        photoreceptor: Photoreceptor,
        origin: FloatArray,
        firing: Firing,
        stages: Sequence[LevelStage],
        kernels: Any,
        threads: int = 1,
        levels: FloatArray | None = None,
    ) -> None:
        self.signs = np.broadcast_to(np.int8(1), origin.size)
        self._receptor, self._origin, self._firing = photoreceptor, origin, firing
        self._stages, self._kernels = stages, kernels
        # The signal that is compared and remembered is the luminosity where that is enough.
        invertible = isinstance(photoreceptor, InvertiblePhotoreceptor)
        self._compares_levels = not invertible or bool(stages) or levels is not None
        if levels is not None:
            signal = levels
        elif self._compares_levels:
            signal = self._light_levels(luminosity.astype(np.float64))
        else:
            signal = luminosity.astype(_signal_type(luminosity.dtype))
        self._signals = [signal.copy() for _ in range(firing.samples)]
        self._pixel_bits = max(1, (origin.size - 1).bit_length())
        cuts = np.linspace(0, origin.size, max(1, min(threads, origin.size)) + 1).astype(int)
        # Cache lines of the state belong to one thread.
        cuts[1:-1] = cuts[1:-1] // 64 * 64
        self._strips = [_Strip(int(a), int(b), kernels.TILE) for a, b in pairwise(cuts)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self._invalid = 0
        self._forget_bands()

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._firing.counts

    @property
    def invalid(self) -> int:
        """Pixel samples without meaning so far."""
        return self._invalid

    def distances(self) -> FloatArray:
        """How far levels lie above references; see `engine.PixelEngine.distances`."""
        levels = self._levels_of(self._signals[0].astype(np.float64))
        lit = np.isfinite(levels)
        return self._firing.distances(np.where(lit, levels, self._origin))

    def start_pixels(self, pixels: NDArray[np.int64], luminosity: NDArray[np.generic]) -> None:
        """Start pixels; see `engine.PixelEngine.start_pixels`."""
        signal: NDArray[Any] = luminosity
        if self._compares_levels:
            signal = self._light_levels(luminosity.astype(np.float64))
        for age in range(len(self._signals)):
            self._own(age)[pixels] = signal
        self._firing.start_pixels(pixels)
        self._bands.forget(pixels)

    def expose(
        self, luminosity: NDArray[np.generic], start_ns: int, duration_ns: int, elapsed_ns: int
    ) -> PixelEvents:
        """Events of an interval; see `engine.PixelEngine.expose`."""
        luminosity = self._adopted(luminosity)
        shift = self._pixel_bits + 2
        if duration_ns.bit_length() + shift > KEY_BITS:
            shift = 0
        interval = Interval(
            start_ns=start_ns, duration_ns=duration_ns, elapsed_ns=elapsed_ns, shift=shift
        )
        self._bands.forget(self._firing.begin(interval, luminosity))
        store = self._remember(luminosity)
        if self._pool is None:
            self._work(self._strips[0], luminosity, store, interval)
        else:
            jobs = [
                self._pool.submit(self._work, strip, luminosity, store, interval)
                for strip in self._strips
            ]
            for job in jobs:
                job.result()
        self._hold()
        return self._collected(interval)

    def _adopted(self, luminosity: NDArray[np.generic]) -> NDArray[Any]:
        """Sample in the number type of those before, which becomes float64 where it must."""
        light = luminosity.astype(_signal_type(luminosity.dtype), copy=False)
        known = self._signals[0].dtype
        if not self._compares_levels and light.dtype != known:
            if not np.can_cast(light.dtype, known):
                self._signals = [samples.astype(np.float64) for samples in self._signals]
                self._forget_bands()
            light = light.astype(self._signals[0].dtype)
        return np.ascontiguousarray(light)

    def _remember(self, luminosity: NDArray[Any]) -> NDArray[Any]:
        """Make place for the sample; return where to copy it, of no entry if it is kept itself."""
        oldest = self._signals.pop()
        kept = not self._compares_levels and is_frozen(luminosity)
        if kept:
            self._signals.insert(0, luminosity)
            return oldest[:0].copy()
        store = oldest if oldest.flags.writeable else np.empty_like(oldest)
        self._signals.insert(0, store)
        return store

    def _own(self, age: int) -> NDArray[Any]:
        """Signal of a sample, to be changed."""
        if not self._signals[age].flags.writeable:
            self._signals[age] = self._signals[age].copy()
        return self._signals[age]

    def _hold(self) -> None:
        """Let pixels without a meaningful sample hold the last one."""
        for strip in self._strips:
            for held in strip.held:
                self._own(0)[held] = self._signals[1][held]
                self._invalid += held.size

    def _work(
        self,
        strip: _Strip,
        luminosity: NDArray[Any],
        store: NDArray[Any],
        interval: Interval,
    ) -> None:
        strip.used, strip.held = 0, []
        for first in range(strip.pixels.start, strip.pixels.stop, _BLOCK):
            block = slice(first, min(first + _BLOCK, strip.pixels.stop))
            number = self._find(strip, block, luminosity, store, interval)
            if number:
                self._fire(strip, strip.found[:number], interval)
        if interval.shift:
            self._sort(strip.keys[: strip.used], interval)

    def _sort(self, keys: NDArray[np.int64], interval: Interval) -> None:
        """Put the events of one strip in order; they come pixel by pixel."""
        if keys.size < _FEW:
            keys.sort()
            return
        last_bit = interval.shift + interval.duration_ns.bit_length()
        self._kernels.radix_sort(keys, np.empty_like(keys), interval.shift, last_bit)

    def _find(
        self,
        strip: _Strip,
        pixels: slice,
        luminosity: NDArray[Any],
        store: NDArray[Any],
        interval: Interval,
    ) -> int:
        """Write down the new signal; number of pixels outside their bands."""
        mask, found = strip.mask, strip.found
        if not self._compares_levels:
            store = store[pixels] if store.size else store
            light = luminosity[pixels].view()
            light.flags.writeable = False
            return self._bands.find(light, pixels, store, mask, found, 0)
        number = 0
        for begin in range(pixels.start, pixels.stop, TILE):
            tile = slice(begin, min(begin + TILE, pixels.stop))
            levels = self._light_levels(np.asarray(luminosity[tile], np.float64))
            for stage in self._stages:
                stage.apply(levels, begin, interval.elapsed_ns, interval.duration_ns)
            number = self._bands.find(levels, tile, store[tile], mask, found, number)
        return number

    def _fire(self, strip: _Strip, found: NDArray[np.int32], interval: Interval) -> None:
        levels = []
        for samples in self._signals:
            values = np.empty(found.size)
            self._kernels.gather(samples, found, values)
            levels.append(self._levels_of(values))
        held = np.empty_like(found)
        invalid = self._kernels.hold_invalid(found, levels[0], levels[1], self._origin, held)
        if invalid:
            strip.held.append(held[:invalid])
        edges = np.empty((2, found.size))
        active = ActivePixels(found=found, levels=levels, interval=interval, edges=edges)
        place = 0
        while place < found.size:
            place, strip.used, needed = self._firing.fire(place, active, strip.keys, strip.used)
            if place < found.size:
                require_bounded(needed)
                strip.keys = _grown(strip.keys, needed, interval.shift)
        self._bands.settle(found, edges)

    def _collected(self, interval: Interval) -> PixelEvents:
        """Events of all strips in order."""
        parts = [strip.keys[: strip.used * (1 if interval.shift else 2)] for strip in self._strips]
        if not interval.shift:
            return _from_words(np.concatenate(parts), interval.start_ns, self._firing.labels)
        keys = reduce(self._merged, parts)
        events = PixelEvents(
            t=np.empty(keys.size, np.int64),
            pixel=np.empty(keys.size, np.int32),
            polarity=np.empty(keys.size, np.int8),
            sign=np.ones(keys.size, np.int8),
            noise=np.empty(keys.size, np.int8),
        )
        columns = (events.t, events.pixel, events.polarity, events.noise)
        self._unpack(keys, interval, columns)
        return events if self._firing.labels else events.unlabelled()

    def _merged(self, one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
        out = np.empty(one.size + other.size, np.int64)
        if self._pool is None or out.size < TILE:
            self._kernels.merge(one, other, out)
            return out
        # Two threads take the earlier and the later half.
        half = one.size // 2
        cut = int(np.searchsorted(other, one[half])) if one.size else 0
        ahead = self._pool.submit(self._kernels.merge, one[:half], other[:cut], out[: half + cut])
        self._kernels.merge(one[half:], other[cut:], out[half + cut :])
        ahead.result()
        return out

    def _unpack(
        self, keys: NDArray[np.int64], interval: Interval, columns: Sequence[NDArray[Any] | None]
    ) -> None:
        def part(which: slice) -> None:
            chosen = [column[which] for column in columns if column is not None]
            self._kernels.unpack_keys(keys[which], interval.start_ns, interval.shift, *chosen)

        if self._pool is None or keys.size < TILE:
            part(slice(None))
            return
        half = keys.size // 2
        ahead = self._pool.submit(part, slice(half))
        part(slice(half, None))
        ahead.result()

    def _light_levels(self, luminosity: FloatArray) -> FloatArray:
        return self._receptor.levels(luminosity, out=np.empty_like(luminosity))

    def _levels_of(self, signal: FloatArray) -> FloatArray:
        if self._compares_levels:
            return signal
        return self._receptor.levels(signal, out=signal)

    def _forget_bands(self) -> None:
        """No pixel is silent until it has been worked on once."""
        self._bands = bands_for(
            self._origin.size,
            self._signals[0].dtype,
            self._firing.half_width,
            self._receptor,
            self._kernels,
            levels=self._compares_levels,
        )


def is_frozen(values: NDArray[Any]) -> bool:
    """Whether an array is immutable: it and all that it is a view of are read-only.

    Parameters
    ----------
    values
        Array.
    """
    owner: Any = values
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    if isinstance(owner, memoryview):
        owner = owner.obj
    return owner is None or isinstance(owner, bytes)


def _signal_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    known = dtype.str[1:] in (*_UNSIGNED, *_FLOATS)
    return dtype.newbyteorder('=') if known else np.dtype(np.float64)


def _grown(keys: NDArray[np.int64], needed: int, shift: int) -> NDArray[np.int64]:
    words = needed if shift else 2 * needed
    larger = np.empty(max(words, 2 * keys.size), np.int64)
    larger[: keys.size] = keys
    return larger


def _from_words(words: NDArray[np.int64], start_ns: int, labelled: bool) -> PixelEvents:
    """Events of an interval so long that no key holds its times."""
    elapsed, low = words.reshape(-1, 2).T
    order = np.lexsort((low, elapsed))
    elapsed, low = elapsed[order], low[order]
    return PixelEvents(
        t=elapsed + start_ns,
        pixel=(low >> 2).astype(np.int32),
        polarity=((low & 2) - 1).astype(np.int8),
        sign=np.ones(low.size, np.int8),
        noise=(low & 1).astype(np.int8) if labelled else None,
    )
