"""What distinguishes a real sensor from the ideal pixel; everything is off by default."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from dvs_common.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections:
    """Non-idealities of the pixels, seeded and reproducible.

    Parameters
    ----------
    threshold_mismatch
        Standard deviation of a pixel's ON and OFF thresholds, each relative to h and frozen.
    refractory_period
        Time after an event in which a pixel fires no other, s. Its reference waits: what the
        luminosity has done meanwhile gives events afterwards, at most one a period, so that no
        polarity is lost.
    leak_rate
        ON events a second of a pixel in constant light, 1/s: the reference leaks.
    event_threshold_off
        Threshold of OFF events, in logarithms to the base b; 0: that of ON events.
    reset
        What the reference becomes at an event. `ladder`: it moves by the threshold. `level`: the
        present level, as in the sensor's circuit; a pixel that fires late (after a refractory
        period, or a spurious event) fires no events for what it has missed.
    shot_noise_rate
        Spurious events a second of a pixel, ON and OFF alike, 1/s. The reference moves with them:
        on the ladder the pixel undoes them at its next crossing, with `reset: level` it does not.
    shot_noise_luminosity
        Luminosity at which a quarter of the shot noise is left, linearly less on the way there, as
        in v2e. 0: the same rate at every luminosity.
    cutoff_frequency
        Corner of the photoreceptor's first-order low-pass, Hz; 0: none.
    cutoff_luminosity
        Luminosity from which on the corner is `cutoff_frequency`; below, it falls in proportion,
        down to a tenth. 0: the same corner at every luminosity.
    hot_pixel_fraction
        Share of pixels that leak at `hot_pixel_rate`.
    hot_pixel_rate
        ON events a second of a hot pixel, 1/s.
    dead_pixel_fraction
        Share of pixels that never fire.
    latency
        Delay of every event, s.
    jitter
        Standard deviation of the delay, s; a delay is never negative.

    Raises
    ------
    ParameterError
        If a value is negative or not finite, or a share exceeds 1.
    """

    threshold_mismatch: float = 0.0
    event_threshold_off: float = 0.0
    reset: str = 'ladder'
    refractory_period: float = 0.0
    leak_rate: float = 0.0
    shot_noise_rate: float = 0.0
    shot_noise_luminosity: float = 0.0
    cutoff_frequency: float = 0.0
    cutoff_luminosity: float = 0.0
    hot_pixel_fraction: float = 0.0
    hot_pixel_rate: float = 100.0
    dead_pixel_fraction: float = 0.0
    latency: float = 0.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.reset not in ('ladder', 'level'):
            raise ParameterError('reset', self.reset, 'must be ladder or level')
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == 'reset':
                continue
            if not 0 <= value < math.inf:
                raise ParameterError(entry.name, value, 'must be >= 0 and finite')
            if entry.name.endswith('_fraction') and value > 1:
                raise ParameterError(entry.name, value, 'must be <= 1')

    @property
    def change_comparators(self) -> bool:
        """Whether the comparators are not those of ideal pixels."""
        return self.reset == 'level' or any(
            (
                self.event_threshold_off,
                self.threshold_mismatch,
                self.refractory_period,
                self.shot_noise_rate,
            )
        )

    @property
    def change_levels(self) -> bool:
        """Whether the levels are not those of ideal pixels."""
        return bool(
            self.leak_rate
            or self.cutoff_frequency
            or self.hot_pixel_fraction
            or self.dead_pixel_fraction
        )

    @property
    def delay_events(self) -> bool:
        """Whether events come later than their cause."""
        return bool(self.latency or self.jitter)

    @property
    def any(self) -> bool:
        """Whether anything is on."""
        return self.change_comparators or self.change_levels or self.delay_events
