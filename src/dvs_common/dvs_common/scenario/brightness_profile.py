"""A scene whose luminosity is not ``c'x`` itself but a curve over it, and the line nearest to it.

The paper's scene is a straight line. A wall, a picture or a lamp is not: a pixel sees ``f(s)`` of
``s = c'(x + dx)``. Around a set-point f is a line with a relative error of its slope, and that
error is what a promise has to bear (docs/brightness_profile.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError

# Share of the reach within which a knot is the set-point itself: its secant is rounding.
_NEAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Linearisation:
    """A line through the luminosity at the set-point, and how far the profile is from it.

    ``|f(D + v) - f(D) - slope v| <= slope_error |slope v|`` for every ``|v| <= reach`` and the
    D of every pixel.

    Parameters
    ----------
    slope
        Slope of the line, luminosity per unit of ``c'x``; negative where the profile falls.
    slope_error
        Largest relative error of a secant through the set-point, in [0, 1).
    steepness
        Largest slope of the profile itself within the reach, relative to `slope`.
    reach
        Largest ``|c'(x - x_d)|`` for which this holds.
    """

    slope: float = 1.0
    slope_error: float = 0.0
    steepness: float = 1.0
    reach: float = math.inf

    @property
    def luminosity_reach(self) -> float:
        """The reach as a change of the line's luminosity."""
        return abs(self.slope) * self.reach

    def __str__(self) -> str:
        """Return it in a few words."""
        return f'brightness profile, slope within {100 * self.slope_error:.3g} %'


@dataclass(frozen=True, slots=True, kw_only=True)
class BrightnessProfile:
    """Luminosity over ``s = c'(x + dx)``: straight between knots, constant beyond the ends.

    Parameters
    ----------
    positions
        s of the knots, shape (k,), k >= 2, increasing.
    luminosities
        Luminosity there, shape (k,), > 0.

    Raises
    ------
    ParameterError
        If there are less than two knots, positions do not increase or a luminosity is not
        positive.
    """

    positions: FloatArray
    luminosities: FloatArray

    def __post_init__(self) -> None:
        """Check the knots and freeze the arrays."""
        for name in ('positions', 'luminosities'):
            array = finite_array('brightness_profile', getattr(self, name), ndim=1)
            object.__setattr__(self, name, array)
        count = self.positions.size
        if count < 2 or self.luminosities.size != count:
            rule = 'must have a luminosity for each of at least two positions'
            raise ParameterError('brightness_profile', [count, self.luminosities.size], rule)
        backwards = np.flatnonzero(np.diff(self.positions) <= 0)
        if backwards.size:
            i = int(backwards[0])
            pair = self.positions[i : i + 2].tolist()
            raise ParameterError('brightness_profile', pair, 'must have positions that increase')
        dark = np.flatnonzero(self.luminosities <= 0)
        if dark.size:
            i = int(dark[0])
            raise ParameterError(
                'brightness_profile',
                float(self.luminosities[i]),
                f'must be > 0 everywhere, and is not at the position {self.positions[i]:g}',
            )

    def luminosity(self, positions: FloatArray) -> FloatArray:
        """Luminosity at positions, that of the nearer end beyond the profile.

        Parameters
        ----------
        positions
            s, any shape.
        """
        return np.asarray(np.interp(positions, self.positions, self.luminosities))

    def covers(self, positions: FloatArray) -> bool:
        """Whether all positions lie within the profile.

        Parameters
        ----------
        positions
            s, any shape.
        """
        return bool(positions.min() >= self.positions[0] and positions.max() <= self.positions[-1])

    def line_around(self, set_points: FloatArray, *, reach: float = 0.0) -> Linearisation:
        """Line with the least relative error of its slope, for all pixels and the whole reach.

        Between two knots the slope of a secant through a fixed point is monotone, so that its
        extremes are those at knots and at the ends of the reach; as far as the next of them on
        either side it is the slope at the set-point itself.

        Parameters
        ----------
        set_points
            D = ``c'(x_d + dx_i)``, shape (r,).
        reach
            Largest ``|c'(x - x_d)|`` that is to be covered; 0 for all that the profile covers.

        Raises
        ------
        ParameterError
            If the reach ends outside of the profile, or the profile does not rise all along, as
            seen from the set-point, nor fall.
        """
        start, end = self.positions[[0, -1]].tolist()
        room = min(float(set_points.min()) - start, end - float(set_points.max()))
        if not room > 0:
            raise ParameterError(
                'set_point',
                [float(set_points.min()), float(set_points.max())],
                f"must be seen within brightness_profile, which goes from c'(x + dx) = {start:g} "
                f'to {end:g}',
            )
        if reach > room * (1 + _NEAR):
            raise ParameterError(
                'profile_reach', reach, f'must not exceed {room:.9g}, where the profile ends'
            )
        reach = min(reach, room) or room
        low, high = self._secants(set_points, reach)
        slope = (low + high) / 2
        if not low * high > 0:
            raise ParameterError(
                'brightness_profile',
                [low, high],
                'must rise all along within profile_reach of the set-point, or fall: these are '
                'the slopes of its secants from there',
            )
        return Linearisation(
            slope=slope,
            slope_error=(high - low) / abs(low + high),
            steepness=max(1.0, self._steepest(set_points, reach) / abs(slope)),
            reach=reach,
        )

    def _secants(self, set_points: FloatArray, reach: float) -> tuple[float, float]:
        """Least and largest slope of a secant through a set-point."""
        seen = self.luminosity(set_points)
        low, high = math.inf, -math.inf
        ends = [set_points - reach, set_points + reach]
        for place in (*self.positions, *ends):
            away = place - set_points
            counts = (np.abs(away) > _NEAR * reach) & (np.abs(away) <= reach * (1 + _NEAR))
            if counts.any():
                risen = self.luminosity(np.broadcast_to(place, seen.shape))[counts] - seen[counts]
                found = risen / away[counts]
                low, high = min(low, float(found.min())), max(high, float(found.max()))
        return low, high

    def _steepest(self, set_points: FloatArray, reach: float) -> float:
        """Largest slope of the profile within the reach, without its sign."""
        slopes = np.abs(np.diff(self.luminosities) / np.diff(self.positions))
        inside = self.positions[1:] >= set_points.min() - reach
        inside &= self.positions[:-1] <= set_points.max() + reach
        return float(slopes[inside].max())
