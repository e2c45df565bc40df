"""What compiled pixels with news do: ideal ones, by a line or a cubic, and imperfect ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.crossings import CountArray
from dvs_event_camera.pixels.hermite import ITERATIONS, tolerance_of
from dvs_event_camera.pixels.pixel_state import ImperfectState

_NO_PIXEL = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """The time between two samples.

    Parameters
    ----------
    start_ns
        Its start, ns.
    duration_ns
        Its length, ns.
    elapsed_ns
        Time from the first sample to its end, ns.
    shift
        Where the time begins in an event's sort key; 0 where it does not fit.
    """

    start_ns: int
    duration_ns: int
    elapsed_ns: int
    shift: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ActivePixels:
    """Pixels with news in an interval.

    Parameters
    ----------
    found
        The pixels, shape (k,).
    levels
        Their levels at the end of the interval, at its start, and of earlier samples.
    interval
        The interval.
    edges
        Out: levels between which each is silent from now on, shape (2, k).
    """

    found: NDArray[np.int32]
    levels: list[FloatArray]
    interval: Interval
    edges: FloatArray


class Firing(Protocol):
    """What `compiled_pixels.CompiledPixels` asks of the law of its pixels."""

    samples: int
    labels: bool

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""

    @property
    def half_width(self) -> float | None:
        """Distance of both thresholds of every pixel from its reference; None where it varies."""

    def distances(self, levels: FloatArray) -> FloatArray:
        """How far levels lie above the references, shape (r,).

        Parameters
        ----------
        levels
            Levels, shape (r,).
        """

    def start_pixels(self, pixels: NDArray[np.int64]) -> None:
        """Start pixels that had no light before.

        Parameters
        ----------
        pixels
            Pixels, shape (k,); their first references are set already.
        """

    def begin(self, interval: Interval, luminosity: NDArray[np.generic]) -> NDArray[np.int64]:
        """Start an interval; return pixels that have news whatever their light does.

        Parameters
        ----------
        interval
            The interval.
        luminosity
            Sample at its end, shape (r,).
        """

    def fire(
        self, place: int, active: ActivePixels, keys: NDArray[np.int64], used: int
    ) -> tuple[int, int, int]:
        """Events of some pixels, as `pixel_kernels.fire_ideal` gives them.

        Parameters
        ----------
        place
            First of the pixels to deal with.
        active
            The pixels.
        keys
            Buffer of sort keys.
        used
            Events in it.
        """


class IdealFiring:
    """Ideal pixels, level linear in time or a monotone cubic through the last four samples.

    Parameters
    ----------
    kernels
        Module `pixel_kernels`.
    origin
        Levels of the first references, shape (r,).
    step
        Threshold as a change of the level, ``h ln b``.
    cubic
        Whether the level is a cubic.
    """

    labels = False

    def __init__(self, kernels: Any, origin: FloatArray, step: float, *, cubic: bool) -> None:
        self._kernels, self._origin, self._step = kernels, origin, step
        self._cubic, self.samples = cubic, 4 if cubic else 2
        self._counts: CountArray = np.zeros(origin.size, np.int32)
        self._durations: list[int] = []

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._counts

    @property
    def half_width(self) -> float | None:
        """The threshold; see `Firing.half_width`."""
        return self._step

    def distances(self, levels: FloatArray) -> FloatArray:
        """How far levels lie above the references; see `Firing.distances`."""
        return ((levels - self._origin) / self._step - self._counts) * self._step

    def start_pixels(self, pixels: NDArray[np.int64]) -> None:
        """Nothing to do; see `Firing.start_pixels`."""

    def begin(self, interval: Interval, luminosity: NDArray[np.generic]) -> NDArray[np.int64]:
        """Take the length of the interval; see `Firing.begin`."""
        self._durations = [interval.duration_ns, *self._durations[:2]]
        return _NO_PIXEL

    def fire(
        self, place: int, active: ActivePixels, keys: NDArray[np.int64], used: int
    ) -> tuple[int, int, int]:
        """Events of some pixels; see `Firing.fire`."""
        levels, interval = active.levels, active.interval
        earlier = [duration / self._durations[0] for duration in self._durations[1:]]
        a1, a2 = (*earlier, 0.0, 0.0)[:2]
        done: tuple[int, int, int] = self._kernels.fire_ideal(
            active.found,
            *(levels if self._cubic else 2 * levels),
            a1,
            a2,
            tolerance_of(interval.duration_ns),
            ITERATIONS if self._cubic else 0,
            self._origin,
            self._counts,
            self._step,
            interval.duration_ns,
            interval.shift,
            keys,
            used,
            active.edges,
        )
        return done


class ImperfectFiring:
    """Pixels with thresholds of their own, a refractory period, shot noise or a physical reset.

    Parameters
    ----------
    kernels
        Module `pixel_kernels`.
    state
        The pixels.
    """

    samples = 2
    labels = True

    def __init__(self, kernels: Any, state: ImperfectState) -> None:
        self._kernels, self._state = kernels, state

    @property
    def counts(self) -> CountArray:
        """N, the sum of polarities so far, shape (r,)."""
        return self._state.counts

    @property
    def half_width(self) -> float | None:
        """The threshold, if all are the same; see `Firing.half_width`."""
        return self._state.half_width

    def distances(self, levels: FloatArray) -> FloatArray:
        """How far levels lie above the references; see `Firing.distances`."""
        return levels - self._state.references(slice(None))

    def start_pixels(self, pixels: NDArray[np.int64]) -> None:
        """Take the new references; see `Firing.start_pixels`."""
        self._state.start_pixels(pixels)

    def begin(self, interval: Interval, luminosity: NDArray[np.generic]) -> NDArray[np.int64]:
        """Draw the shot noise; see `Firing.begin`."""
        self._state.shots.draw(interval.duration_ns, luminosity)
        return self._state.shots.pixel[:-1]

    def fire(
        self, place: int, active: ActivePixels, keys: NDArray[np.int64], used: int
    ) -> tuple[int, int, int]:
        """Events of some pixels; see `Firing.fire`."""
        state, interval = self._state, active.interval
        thresholds = slice(None) if state.own_thresholds else slice(1)
        done: tuple[int, int, int] = self._kernels.fire_imperfect(
            place,
            active.found,
            active.levels[0],
            active.levels[1],
            state.origin,
            state.present,
            state.ladder,
            state.on,
            state.off,
            state.on_thresholds[thresholds],
            state.off_thresholds[thresholds],
            state.refractory_ns,
            state.ready_ns,
            state.shots.pixel,
            state.shots.when,
            state.shots.polarity,
            interval.start_ns,
            interval.duration_ns,
            interval.shift,
            keys,
            used,
            active.edges,
        )
        return done
