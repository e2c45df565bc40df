"""The trigger references at the start: where they may lie (A1) and where they do."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_event_camera.pixels.photoreceptor import Photoreceptor

InitialReference = Literal['luminosity', 'lower', 'upper', 'random']


def reference_levels(photoreceptor: Photoreceptor, reference: FloatArray) -> FloatArray:
    """Level of a reference ``|q| > 0``.

    Parameters
    ----------
    photoreceptor
        How luminosity becomes a level.
    reference
        ``|q|``, shape (r,).
    """
    if photoreceptor.dead_band is not None:
        return np.asarray(np.log(reference))
    return photoreceptor.levels(reference)


def narrowed(
    luminosity: FloatArray, uncertainty: float, photoreceptor: Photoreceptor, step: float
) -> ReferenceBounds:
    """Bounds around the first sample, without their width where (A1) would not hold.

    Parameters
    ----------
    luminosity
        First sample y(0), not zero and finite, shape (r,).
    uncertainty
        dy >= 0, in the unit of luminosity.
    photoreceptor
        How luminosity becomes a level.
    step
        Threshold as a change of the level, ``h ln b``.
    """
    magnitude = np.abs(luminosity)
    level = reference_levels(photoreceptor, magnitude)
    lower = np.where(magnitude > uncertainty, magnitude - uncertainty, magnitude)
    upper = magnitude + uncertainty
    fits = (
        (magnitude > uncertainty)
        & (level - reference_levels(photoreceptor, lower) < step)
        & (reference_levels(photoreceptor, upper) - level < step)
    )
    return ReferenceBounds(
        lower=np.where(fits, lower, magnitude), upper=np.where(fits, upper, magnitude)
    )


def require_silent_start(
    bounds: ReferenceBounds, luminosity: FloatArray, photoreceptor: Photoreceptor, step: float
) -> None:
    """Check (A1): whatever ``q(0)`` in ``[m, M]`` is, no pixel fires at the first sample.

    Pixels whose luminosity has no level have no first sample yet.

    Parameters
    ----------
    bounds
        m and M, shape (r,).
    luminosity
        First sample y(0), shape (r,).
    photoreceptor
        How luminosity becomes a level.
    step
        Threshold as a change of the level, ``h ln b``.

    Raises
    ------
    ParameterError
        If the number of pixels differs or some pixel would fire; names the pixel and the numbers.
    """
    if bounds.lower.size != luminosity.size:
        raise ParameterError(
            'reference_lower',
            bounds.lower.size,
            f'must have {luminosity.size} entries, one a pixel',
        )
    level = photoreceptor.levels(luminosity)
    lit = np.isfinite(level)
    above = level - reference_levels(photoreceptor, bounds.lower)
    below = reference_levels(photoreceptor, bounds.upper) - level
    for name, limit, gap in (
        ('reference_lower', bounds.lower, above),
        ('reference_upper', bounds.upper, below),
    ):
        if (bad := np.flatnonzero(lit & ~(gap < step))).size:
            i = int(bad[0])
            raise ParameterError(
                name,
                float(limit[i]),
                f'of pixel {i} lies {gap[i] / step:.6g} thresholds from its first luminosity '
                f'{luminosity[i]:.9g}, so the pixel could fire at the first sample: must be less '
                f'than 1 (paper, A1)',
            )


def initial_references(
    kind: str | FloatArray, bounds: ReferenceBounds, luminosity: FloatArray, seed: int
) -> FloatArray:
    """``|q(0)|`` of every pixel, shape (r,).

    Parameters
    ----------
    kind
        `luminosity` (``|y(0)|``), `lower` (m), `upper` (M) or `random` (log-uniform in [m, M]);
        or the references themselves, shape (r,).
    bounds
        m and M, shape (r,).
    luminosity
        First sample y(0), shape (r,).
    seed
        Of the random references.

    Raises
    ------
    ParameterError
        If `kind` is unknown, or a reference lies outside [m, M].
    """
    if not isinstance(kind, str):
        return _given_references(kind, bounds)
    if kind not in get_args(InitialReference):
        raise ParameterError(
            'initial_reference', kind, f'must be one of {", ".join(get_args(InitialReference))}'
        )
    if kind == 'lower':
        return bounds.lower.copy()
    if kind == 'upper':
        return bounds.upper.copy()
    if kind == 'random':
        fraction = np.random.default_rng(seed).random(bounds.lower.size)
        return bounds.lower * (bounds.upper / bounds.lower) ** fraction
    reference = np.abs(luminosity)
    if (bad := np.flatnonzero((reference < bounds.lower) | (reference > bounds.upper))).size:
        i = int(bad[0])
        raise ParameterError(
            'initial_reference',
            kind,
            f'|y(0)| = {reference[i]:.9g} of pixel {i} lies outside its bounds '
            f'[{bounds.lower[i]:.9g}, {bounds.upper[i]:.9g}] (paper, A1)',
        )
    return reference


def _given_references(references: FloatArray, bounds: ReferenceBounds) -> FloatArray:
    given = np.asarray(references, np.float64)
    within = given.shape == bounds.lower.shape and bool(
        np.all((given >= bounds.lower) & (given <= bounds.upper))
    )
    if not within:
        raise ParameterError(
            'initial_reference',
            given.tolist(),
            f'must have {bounds.lower.size} entries, each within its bounds (paper, A1)',
        )
    return given.copy()
