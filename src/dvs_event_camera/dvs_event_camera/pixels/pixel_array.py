"""The pixels of an event camera: samples of luminosity in, events out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import NANOSECONDS
from dvs_common.scenario.reference_bounds import ReferenceBounds, threshold_step
from dvs_event_camera.pixels.compiled import kernels_for
from dvs_event_camera.pixels.delay_line import DelayLine
from dvs_event_camera.pixels.engine import PixelEngine
from dvs_event_camera.pixels.engine_choice import PixelLaw, engine_of
from dvs_event_camera.pixels.event_flood import EventFlood
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.level_stages import Leak, LevelStage, level_stages
from dvs_event_camera.pixels.noise_labels import noise_labels_of
from dvs_event_camera.pixels.photoreceptor import LogPhotoreceptor, Photoreceptor
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.pixels.pixel_state import ImperfectState
from dvs_event_camera.pixels.possible_pixels import require_possible
from dvs_event_camera.pixels.references import (
    initial_references,
    narrowed,
    reference_levels,
    require_silent_start,
)
from dvs_event_camera.pixels.silent_band import SilentBand, silent_band_of

# Position of a level, in steps from its reference, at which a pixel is about to fire.
_INSIDE = 1 - 1e-9


class PixelArray:
    """r pixels that fire when the log luminosity has moved by h since their last event (eq. 5).

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
        `luminosity`, `lower`, `upper` or `random`: where in [m, M] the references start; or the
        references themselves, shape (r,).
    strict_start
        Whether a pixel that `reference_uncertainty` would let fire at the first sample is an
        error; otherwise its reference is its first luminosity.
    seed
        Of every random draw.
    interpolation
        `linear_log`: the level is linear in time between samples; `hermite`: a monotone cubic.
    imperfections
        Non-idealities; None for the ideal pixel of the paper.
    label_noise
        Whether events carry labels that mark noise.
    backend
        `numba`, `numpy` or `auto` (numba where it is installed and pays): same results.
    threads
        Threads that share the pixels by rows, where they are compiled: same results.

    Raises
    ------
    ParameterError
        If h, b, the uncertainty, the kind of reference or the number of threads is out of range.
    """

    def __init__(
        self,
        *,
        event_threshold: float,
        log_base: float = math.e,
        photoreceptor: Photoreceptor | None = None,
        bounds: ReferenceBounds | None = None,
        reference_uncertainty: float = 0.0,
        initial_reference: str | FloatArray = 'luminosity',
        strict_start: bool = True,
        seed: int = 0,
        interpolation: str = 'linear_log',
        imperfections: Imperfections | None = None,
        label_noise: bool = False,
        backend: str = 'auto',
        threads: int = 1,
    ) -> None:
        self.log_step = threshold_step(event_threshold, log_base)
        self._event_threshold = event_threshold
        self._log_base, self._invalid_before = log_base, 0
        self._receptor: Photoreceptor = photoreceptor or LogPhotoreceptor()
        self._imperfections = imperfections or Imperfections()
        off = self._imperfections.event_threshold_off
        self._off_step = threshold_step(off, log_base) if off else self.log_step
        self._interpolation = interpolation
        self._label_noise = label_noise
        self._explicit_bounds, self._uncertainty = bounds, reference_uncertainty
        self._initial_reference, self._strict_start = initial_reference, strict_start
        self._seed = seed
        self._backend, self._threads = backend, threads
        require_possible(
            photoreceptor=self._receptor,
            interpolation=interpolation,
            imperfections=self._imperfections,
            threads=threads,
        )
        self._stamp_ns: int | None = None
        self._bounds: ReferenceBounds
        self._waiting: NDArray[np.int64] = np.empty(0, np.int64)
        self._silent_frame: Sequence[float] | None = None
        self.engine: PixelEngine

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last sample, ns; None before the first."""
        return self._stamp_ns

    @property
    def counts(self) -> NDArray[np.int32]:
        """N, the sum of polarities given out since the first sample, shape (r,); a copy."""
        counts = self.engine.counts.copy()
        if self.delay is not None:
            counts -= self.delay.held_counts(counts.size).astype(np.int32)
        return counts

    @property
    def signs(self) -> NDArray[np.int8]:
        """Sign s of every reference, shape (r,); a copy. All +1 but with `signed_log`."""
        return self.engine.signs.copy()

    @property
    def event_threshold(self) -> float:
        """h at which the pixels fire now."""
        return self._event_threshold

    @property
    def bounds(self) -> ReferenceBounds:
        """Bounds m and M that were checked at the first sample."""
        return self._bounds

    @property
    def reference_levels(self) -> FloatArray:
        """Level of every reference (log |q|) of ideal pixels, shape (r,)."""
        return self._origin + self.engine.counts * self.log_step

    @property
    def invalid_samples(self) -> int:
        """Pixel samples so far without meaning (y <= 0, NaN, infinite), at which a pixel held."""
        return self._invalid_before + self.engine.invalid

    @property
    def waiting(self) -> NDArray[np.int64]:
        """Pixels that have seen no light yet, so that they have no reference; a copy."""
        return self._waiting.copy()

    @property
    def waiting_pixels(self) -> int:
        """Pixels that have had no light yet and start with their first luminosity."""
        return int(self._waiting.size)

    def require_changeable_threshold(self) -> None:
        """Raise `ParameterError` unless the threshold of these pixels can change on the way."""
        ideal = self._interpolation == 'linear_log' and not self._imperfections.any
        if not ideal or self._receptor.dead_band is not None:
            raise ParameterError(
                'event_threshold',
                'new value',
                'can change on the way for ideal pixels with linear_log interpolation only; '
                'deactivate event_camera first',
            )

    def change_event_threshold(self, event_threshold: float) -> None:
        """Fire at another threshold from now on: references stay, counting starts again at zero.

        Where the level is already farther from its reference than the new threshold, the pixel
        fires in the next interval.

        Parameters
        ----------
        event_threshold
            New h.

        Raises
        ------
        ParameterError
            If h is out of range or the pixels are not ideal ones.
        """
        self.require_changeable_threshold()
        step = threshold_step(event_threshold, self._log_base)
        self._catch_up()
        origin = self.reference_levels
        position = np.clip(self.engine.distances() / step, -_INSIDE, _INSIDE)
        self._invalid_before += self.engine.invalid
        self._origin, self.log_step, self._off_step = origin, step, step
        self._event_threshold = event_threshold
        self.engine = engine_of(
            PixelLaw(photoreceptor=self._receptor, step=step),
            origin,
            origin + position * step,
            origin,
            backend=self._backend,
            threads=self._threads,
            from_levels=True,
        )
        self._band = self._silent_band()

    def update(self, stamp_ns: int, luminosity: ArrayLike) -> PixelEvents:
        """Take the next sample and return the events since the last one.

        The first sample starts the array: it checks (A1), sets the references and emits nothing.
        Where a later sample has no meaning to the photoreceptor the pixel keeps its last value;
        where the first one has none, the pixel starts with its first luminosity.

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
        EventFlood
            If the interval has too many events; the next sample starts the array again.
        """
        sample = np.asarray(luminosity).reshape(-1)
        if self._stamp_ns is None:
            self._start(sample)
            self._first_ns = self._exposed_ns = self._stamp_ns = stamp_ns
            return PixelEvents.empty()
        if sample.size != self._origin.size:
            raise ParameterError(
                'luminosity', sample.size, f'must have {self._origin.size} entries, as before'
            )
        if stamp_ns <= self._stamp_ns:
            raise ParameterError(
                'stamp_ns', stamp_ns, f'must be later than the last, {self._stamp_ns}'
            )
        if self._waiting.size:
            self._start_waiting(stamp_ns, sample)
        if self._band is not None and self.pass_silence(stamp_ns, sample.tolist()):
            return PixelEvents.empty()
        try:
            self._catch_up()
            events = self._expose(stamp_ns, sample)
        except EventFlood:
            self._stamp_ns = None
            raise
        if self._band is not None:
            self._band = self._silent_band()
        self._stamp_ns = stamp_ns
        return events

    def _start_waiting(self, stamp_ns: int, sample: NDArray[np.generic]) -> None:
        """Start the pixels that see their first light in this sample, at rest on it."""
        light = sample[self._waiting]
        floored = self._receptor.floored(light.astype(np.float64))
        levels = self._receptor.levels(floored)
        lit = np.isfinite(levels)
        if not lit.any():
            return
        self._catch_up()
        pixels, light, levels = self._waiting[lit], light[lit], levels[lit]
        self._waiting = self._waiting[~lit]
        self._origin[pixels] = levels
        started = narrowed(floored[lit], self._uncertainty, self._receptor, self.log_step)
        lower, upper = self._bounds.lower.copy(), self._bounds.upper.copy()
        lower[pixels], upper[pixels] = started.lower, started.upper
        self._bounds = ReferenceBounds(lower=lower, upper=upper)
        for stage in self.stages:
            stage.start_pixels(pixels, levels, stamp_ns - self._first_ns)
        self.engine.start_pixels(pixels, light)
        self._band = self._silent_band()

    def pass_silence(self, stamp_ns: int, luminosity: Sequence[float]) -> bool:
        """Take the next sample of a small array if it is silent; return whether it was taken.

        Parameters
        ----------
        stamp_ns
            Time of the sample, ns.
        luminosity
            y, r entries.
        """
        if self._stamp_ns is None or self._band is None or self._waiting.size:
            return False
        if stamp_ns <= self._stamp_ns or not self._band.holds(luminosity):
            return False
        self._silent_frame, self._stamp_ns = luminosity, stamp_ns
        return True

    def _catch_up(self) -> None:
        """Let the comparators see the last silent frame."""
        if self._silent_frame is not None:
            assert self._stamp_ns is not None
            self._expose(self._stamp_ns, np.array(self._silent_frame))
            self._silent_frame = None

    def _silent_band(self) -> SilentBand | None:
        if self._labels is not None or self.delay is not None or self.stages:
            return None
        return silent_band_of(self.engine, self._receptor, self.reference_levels, self.log_step)

    def _expose(self, stamp_ns: int, sample: NDArray[np.generic]) -> PixelEvents:
        """Events since the frame that the comparators saw last."""
        duration_ns = stamp_ns - self._exposed_ns
        elapsed_ns = stamp_ns - self._first_ns
        events = self.engine.expose(sample, self._exposed_ns, duration_ns, elapsed_ns)
        self._exposed_ns = stamp_ns
        if self._labels is not None:
            leak = next((stage for stage in self.stages if isinstance(stage, Leak)), None)
            events = self._labels.label(events, leak, stamp_ns, elapsed_ns)
        if self.delay is not None:
            events = self.delay.pass_through(events, stamp_ns)
        return events

    def _start(self, luminosity: NDArray[np.generic]) -> None:
        sample = self._receptor.floored(luminosity.astype(np.float64))
        dark = ~np.isfinite(self._receptor.levels(sample.copy()))
        self._waiting = np.flatnonzero(dark)
        bounds = self._explicit_bounds
        if dark.any():
            # Something to compute with, until the pixel sees light.
            stand_in = 1.0 + 2 * self._uncertainty if bounds is None else bounds.lower
            sample = np.where(dark, stand_in, sample)
        bounds = bounds or self._bounds_around(sample)
        require_silent_start(bounds, sample, self._receptor, min(self.log_step, self._off_step))
        references = initial_references(self._initial_reference, bounds, sample, self._seed)
        self._bounds = bounds
        self._origin = np.array(reference_levels(self._receptor, references))
        self.first_levels: FloatArray = np.where(dark, self._origin, self._receptor.levels(sample))
        self._build(luminosity, self.first_levels)
        self._band = self._silent_band()

    def _bounds_around(self, sample: FloatArray) -> ReferenceBounds:
        if self._strict_start:
            return ReferenceBounds.around(sample, self._uncertainty)
        return narrowed(sample, self._uncertainty, self._receptor, self.log_step)

    def _build(self, luminosity: NDArray[np.generic], levels: FloatArray) -> None:
        """Make engine, stages and delay line; every random draw has a stream of its own."""
        wanted = self._imperfections
        kernels = kernels_for(self._backend, levels.size)
        streams = [np.random.default_rng([self._seed, number]) for number in range(3)]
        state = (
            ImperfectState(self._origin, self.log_step, self._off_step, wanted, streams[0])
            if wanted.change_comparators
            else None
        )
        self.stages: list[LevelStage] = []
        if wanted.change_levels:
            self.stages = level_stages(wanted, levels, self.log_step, streams[1], kernels)
        law = PixelLaw(
            photoreceptor=self._receptor,
            step=self.log_step,
            cubic=self._interpolation == 'hermite',
            state=state,
            stages=self.stages,
        )
        self.engine = engine_of(
            law,
            luminosity,
            levels,
            self._origin,
            backend=self._backend,
            threads=self._threads,
        )
        self._labels = noise_labels_of(wanted, levels.size, kernels) if self._label_noise else None
        self.delay = (
            DelayLine(
                wanted.latency * NANOSECONDS, wanted.jitter * NANOSECONDS, streams[2], kernels
            )
            if wanted.delay_events
            else None
        )
