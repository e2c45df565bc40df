"""Which engine computes the events of a pixel array."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_event_camera.pixels.comparators import Comparator, NumpyComparator
from dvs_event_camera.pixels.compiled import kernels_for
from dvs_event_camera.pixels.compiled_pixels import CompiledPixels
from dvs_event_camera.pixels.engine import NumpyPixels, PixelEngine
from dvs_event_camera.pixels.firing import Firing, IdealFiring, ImperfectFiring
from dvs_event_camera.pixels.hermite import HermiteComparator
from dvs_event_camera.pixels.imperfect_comparator import ImperfectComparator
from dvs_event_camera.pixels.level_stages import LevelStage
from dvs_event_camera.pixels.photoreceptor import Photoreceptor
from dvs_event_camera.pixels.pixel_state import ImperfectState
from dvs_event_camera.pixels.signed_crossings import SignedComparator


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelLaw:
    """What the pixels of an array have in common.

    Parameters
    ----------
    photoreceptor
        How luminosity becomes a level.
    step
        Threshold as a change of the level, ``h ln b``.
    cubic
        Whether the level between two samples is a cubic.
    state
        Imperfect pixels; None for ideal ones.
    stages
        What happens to a level before it is compared.
    """

    photoreceptor: Photoreceptor
    step: float
    cubic: bool = False
    state: ImperfectState | None = None
    stages: Sequence[LevelStage] = ()


def engine_of(
    law: PixelLaw,
    luminosity: NDArray[np.generic],
    levels: FloatArray,
    origin: FloatArray,
    *,
    backend: str,
    threads: int = 1,
    from_levels: bool = False,
) -> PixelEngine:
    """Engine for a pixel array.

    Parameters
    ----------
    law
        What the pixels have in common.
    luminosity
        First sample, shape (r,).
    levels
        Its levels; those of the references where it has none, shape (r,).
    origin
        Levels of the first references, shape (r,).
    backend
        `numba`, `numpy`, or `auto`: numba if it is installed and the array is large.
    threads
        Threads that share the pixels, where they are compiled.
    from_levels
        Whether the pixels start from `levels` and not from those of `luminosity`.

    Raises
    ------
    ParameterError
        If `backend` is unknown or not installed.
    """
    kernels = kernels_for(backend, origin.size)
    receptor = law.photoreceptor
    if receptor.dead_band is not None:
        light = luminosity.astype(np.float64)
        light = np.where(np.isfinite(light), light, np.exp(origin))
        signed = SignedComparator(light, origin, law.step, receptor.dead_band)
        return NumpyPixels(signed, receptor, law.stages)
    if kernels is None:
        return NumpyPixels(_comparator(law, levels, origin), receptor, law.stages)
    return CompiledPixels(
        luminosity,
        receptor,
        origin,
        _firing(law, origin, kernels),
        law.stages,
        kernels,
        threads,
        levels if from_levels else None,
    )


def _comparator(law: PixelLaw, levels: FloatArray, origin: FloatArray) -> Comparator:
    if law.state is not None:
        return ImperfectComparator(levels, law.state)
    if law.cubic:
        return HermiteComparator(levels, origin, law.step)
    return NumpyComparator(levels, origin, law.step)


def _firing(law: PixelLaw, origin: FloatArray, kernels: Any) -> Firing:
    if law.state is not None:
        return ImperfectFiring(kernels, law.state)
    return IdealFiring(kernels, origin, law.step, cubic=law.cubic)
