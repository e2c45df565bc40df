"""Which choices of photoreceptor, interpolation and imperfections go together."""

from __future__ import annotations

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import Photoreceptor

_MOST_THREADS = 64


def require_possible(
    *,
    photoreceptor: Photoreceptor,
    interpolation: str,
    imperfections: Imperfections,
    threads: int,
) -> None:
    """Refuse pixels that no engine computes.

    Parameters
    ----------
    photoreceptor
        How luminosity becomes a level.
    interpolation
        `linear_log` or `hermite`.
    imperfections
        Non-idealities.
    threads
        Threads that share the pixels.

    Raises
    ------
    ParameterError
        If a choice is unknown or does not go with another.
    """
    if not 1 <= threads <= _MOST_THREADS:
        raise ParameterError('threads', threads, f'must be >= 1 and <= {_MOST_THREADS}')
    if interpolation not in ('linear_log', 'hermite'):
        raise ParameterError('interpolation', interpolation, 'must be linear_log or hermite')
    hermite = interpolation == 'hermite'
    if photoreceptor.dead_band is not None and (hermite or imperfections.any):
        raise ParameterError(
            'photoreceptor',
            'signed_log',
            'is no real sensor: it has neither imperfections nor hermite interpolation',
        )
    if hermite and imperfections.change_comparators:
        raise ParameterError(
            'interpolation',
            interpolation,
            'must be linear_log with event_threshold_off, reset: level, threshold_mismatch, '
            'refractory_period or shot_noise_rate',
        )
