"""From luminosity to the level that a pixel compares: the photoreceptor as a strategy.

A level is a natural logarithm (or what takes its place); an event is a change of the level by
``h ln b``. A level that is not finite means that the luminosity has no meaning for this
photoreceptor; the pixel array counts it and the pixel holds its last value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError


class Photoreceptor(Protocol):
    """What a pixel array asks of a photoreceptor; write your own with these members."""

    @property
    def dead_band(self) -> float | None:
        """Half-width of the silent band around zero, or None where negative light is an error."""

    def levels(self, luminosity: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """Level of every pixel; NaN or infinite where `luminosity` has no meaning.

        Parameters
        ----------
        luminosity
            Luminosity, any shape.
        out
            Where to write the levels, of the same shape; a new array if None.
        """

    def floored(self, luminosity: FloatArray) -> FloatArray:
        """Smallest luminosities with the same level as `luminosity`, or itself.

        Parameters
        ----------
        luminosity
            Luminosity, any shape.
        """


@runtime_checkable
class InvertiblePhotoreceptor(Photoreceptor, Protocol):
    """A photoreceptor whose pixels without events show by their luminosity alone: much faster."""

    def luminosity(self, levels: FloatArray) -> FloatArray:
        """Luminosity at which a level is reached from below; non-decreasing.

        Parameters
        ----------
        levels
            Levels, any shape; -inf in return where every luminosity lies above.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPhotoreceptor:
    """``ln max(y, log_floor)``: the pixel of the paper (eq. 5), which needs y > 0.

    Parameters
    ----------
    log_floor
        Luminosity below which the photoreceptor sees no difference; 0 (the paper) makes y <= 0
        an error.

    Raises
    ------
    ParameterError
        If `log_floor` is negative or not finite.
    """

    log_floor: float = 0.0

    def __post_init__(self) -> None:
        """Check the floor."""
        if not 0 <= self.log_floor < math.inf:
            raise ParameterError('log_floor', self.log_floor, 'must be >= 0 and finite')

    @property
    def dead_band(self) -> float | None:
        """None: negative light is an error."""
        return None

    def levels(self, luminosity: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """``ln max(y, log_floor)``; see `Photoreceptor.levels`."""
        if self.log_floor > 0:
            luminosity = np.maximum(luminosity, self.log_floor, out=out)
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.log(luminosity, out=out)

    def luminosity(self, levels: FloatArray) -> FloatArray:
        """``exp level``, -inf below the floor; see `InvertiblePhotoreceptor.luminosity`."""
        with np.errstate(over='ignore'):
            luminosity = np.exp(levels)
        if self.log_floor > 0:
            luminosity[levels < math.log(self.log_floor)] = -math.inf
        return luminosity

    def floored(self, luminosity: FloatArray) -> FloatArray:
        """``max(y, log_floor)``; see `Photoreceptor.floored`."""
        return np.maximum(luminosity, self.log_floor) if self.log_floor > 0 else luminosity


@dataclass(frozen=True, slots=True, kw_only=True)
class LinLogPhotoreceptor:
    """Linear up to a knee, logarithmic above it, continuous at the knee.

    The mapping of v2e (Hu, Liu, Delbruck: *v2e: From Video Frames to Realistic DVS Events*, CVPR
    workshops 2021, section 4.1), which spares dark 8-bit images the coarse steps of a logarithm:
    ``y ln(k) / k`` for y <= k and ``ln y`` above, k being `knee`.

    Parameters
    ----------
    knee
        k, in the unit of luminosity, > 1 (20 grey levels in v2e).

    Raises
    ------
    ParameterError
        If `knee` is not > 1 and finite.
    """

    knee: float = 20.0

    def __post_init__(self) -> None:
        """Check the knee."""
        if not 1 < self.knee < math.inf:
            raise ParameterError('lin_log_knee', self.knee, 'must be > 1 and finite')

    @property
    def dead_band(self) -> float | None:
        """None: negative light is an error."""
        return None

    def levels(self, luminosity: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """``y ln(k) / k`` up to k, ``ln y`` above; NaN where y < 0; see `Photoreceptor.levels`."""
        slope = math.log(self.knee) / self.knee
        linear = np.where(luminosity >= 0, luminosity * slope, np.nan)
        with np.errstate(divide='ignore', invalid='ignore'):
            levels = np.where(luminosity > self.knee, np.log(luminosity), linear)
        if out is None:
            return levels
        out[...] = levels
        return out

    def luminosity(self, levels: FloatArray) -> FloatArray:
        """``level k / ln(k)``, at least 0, up to the knee, ``exp level`` above.

        See `InvertiblePhotoreceptor.luminosity`.
        """
        knee_level = math.log(self.knee)
        with np.errstate(over='ignore'):
            above = np.exp(levels)
        below = np.maximum(levels, 0.0) * (self.knee / knee_level)
        return np.where(levels > knee_level, above, below)

    def floored(self, luminosity: FloatArray) -> FloatArray:
        """``max(y, 1e-9 k)``: a reference must be positive, and near zero the mapping is linear.

        See `Photoreceptor.floored`.
        """
        return np.where(luminosity == 0, 1e-9 * self.knee, luminosity)


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedLogPhotoreceptor:
    """``ln max(|y|, dead_band)`` with the sign of y beside it: **no real sensor does this**.

    Light is not negative. The published example of the paper lets its luminosity change sign all
    the same; this photoreceptor exists to run it. Inside ``|y| < dead_band`` the pixel is silent.

    Parameters
    ----------
    dead_band
        Half-width d of the silent band around zero, in the unit of luminosity, > 0 (paper,
        section IV: 1e-4).

    Raises
    ------
    ParameterError
        If `dead_band` is not positive and finite.
    """

    dead_band: float = 1e-4

    def __post_init__(self) -> None:
        """Check the band."""
        if not 0 < self.dead_band < math.inf:
            raise ParameterError('dead_band', self.dead_band, 'must be > 0 and finite')

    def levels(self, luminosity: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """``ln max(|y|, d)``; see `Photoreceptor.levels`."""
        magnitude = np.maximum(np.abs(luminosity, out=out), self.dead_band, out=out)
        return np.log(magnitude, out=out)

    def floored(self, luminosity: FloatArray) -> FloatArray:
        """The luminosity itself: the reference bounds are those of the controller.

        See `Photoreceptor.floored`.
        """
        return luminosity
