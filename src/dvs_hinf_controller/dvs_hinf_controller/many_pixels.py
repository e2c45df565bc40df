"""Sums over very many pixels, taken once for all thresholds.

The sum of ``tanh(s + w_i)`` is wanted for many s. A class of pixels whose widths lie within 0.1 of
a middle a has, with ``t = tanh(s + a)`` and ``u_i = tanh(w_i - a)``,

    tanh(s + w_i) = (t + u_i) / (1 + t u_i) = t - (1 - t^2) sum over k >= 1 of (-u_i)^k t^(k-1),

so that the sums of the powers of u_i, taken once, serve for every s: a design takes hardly longer
for a million pixels than for one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.sector_means import SectorMeans, Sectors, SeenPixels

# Pixels that are worked on at a time: they stay in the processor's cache.
_BLOCK = 16_384
# Widest half of a class in w, and the part of a sector that may be left out.
_HALF_CLASS, _NEGLIGIBLE = 0.1, 1e-14
# Relative distance of levels of light between which a curve is taken for straight.
_LIGHT_STEP = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Class:
    """Pixels of one group with about the same width.

    Parameters
    ----------
    group
        Its number.
    low
        Least width.
    high
        Largest width.
    powers
        Sums of ``u_i^k`` for k from 0 on.
    weighted
        Sums of ``|D_i| u_i^k``.
    """

    group: int
    low: float
    high: float
    powers: FloatArray
    weighted: FloatArray

    def sector_sums(self, level: float) -> tuple[float, float]:
        """Sums of delta_i and of ``delta_i |D_i|``; at least as large where some are 0."""
        if level + self.low >= 0:
            t = math.tanh(level + (self.low + self.high) / 2)
            k = np.arange(1, self.powers.size)
            terms = np.append(t, (1 - t * t) * (-t) ** (k - 1))
        else:
            terms = np.zeros(self.powers.size)
            terms[0] = math.tanh(max(level + self.high, 0.0))
        return float(terms @ self.powers), float(terms @ self.weighted)


class ManyPixels:
    """Takes sums once, in two passes; for the rest see `FewPixels`.

    Parameters
    ----------
    seen
        Pixels at the set-point.
    """

    def __init__(self, seen: SeenPixels) -> None:
        self._scene, self._bounds = seen.scene, seen.bounds
        self._positions = (seen.model.gradients @ seen.state).tolist()
        groups = range(seen.model.group_count)
        counts, totals, squares = (np.zeros(len(groups)) for _ in range(3))
        self.least, self._most = np.full(len(groups), math.inf), np.zeros(len(groups))
        ratios = np.array([[math.inf, 0.0]] * len(groups))
        for group in groups:
            for levels, ratio in self._blocks(group):
                counts[group] += levels.size
                totals[group] += levels.sum()
                squares[group] += np.einsum('i,i->', levels, levels)
                self.least[group] = min(self.least[group], levels.min())
                self._most[group] = max(self._most[group], levels.max())
                near, far = ratios[group]
                ratios[group] = min(near, ratio.min()), max(far, ratio.max())
        self._counts = counts
        self._lights: list[tuple[FloatArray, FloatArray]] | None = None
        self.rms = math.sqrt(squares.sum() / counts.sum())
        self.mean = float(totals.sum() / counts.sum())
        self.group_means = totals / counts
        self.worst_ratio = float(1 / ratios.max())
        self.widest = float(0.5 * np.log(ratios.max()))
        self._classes = [
            one for group in groups for one in self._classified(group, *ratios[group])
        ]

    def _blocks(self, group: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """``|D_i|`` and ``M_i / m_i`` of the pixels of a group, some at a time."""
        scene, position = self._scene, self._positions[group]
        mine = None if scene.groups is None else scene.pixels_of(group)
        for begin in range(0, scene.pixel_count if mine is None else mine.size, _BLOCK):
            block = slice(begin, begin + _BLOCK)
            chosen = block if mine is None else mine[block]
            levels = position + scene.brightness_offsets[chosen]
            if scene.profile is not None:
                levels = scene.profile.luminosity(levels)
            yield np.abs(levels), self._bounds.upper[chosen] / self._bounds.lower[chosen]

    def _classified(self, group: int, least: float, most: float) -> list[_Class]:
        """Classes of a group, none wider than `_HALF_CLASS` to either side."""
        number = max(1, math.ceil(0.25 * math.log(most / least) / _HALF_CLASS))
        edges = np.geomspace(least, most, number + 1)
        edges[0], edges[-1] = least, most
        half = 0.25 * math.log(edges[1] / edges[0])
        farthest = math.tanh(half)
        terms = 1 + (math.ceil(math.log(_NEGLIGIBLE) / math.log(farthest)) if farthest else 0)
        powers, weighted = np.zeros((number, terms)), np.zeros((number, terms))
        for levels, ratio in self._blocks(group):
            which = np.searchsorted(edges[1:-1], ratio) if number > 1 else None
            for one in range(number):
                chosen = slice(None) if which is None else which == one
                near, middle = ratio[chosen], math.sqrt(edges[one] * edges[one + 1])
                u, light = (near - middle) / (near + middle), levels[chosen]
                powers[one, 0] += u.size
                weighted[one, 0] += light.sum()
                power = u.copy()
                for k in range(1, terms):
                    powers[one, k] += power.sum()
                    weighted[one, k] += np.einsum('i,i->', power, light)
                    power *= u
        widths = 0.5 * np.log(edges)
        return [
            _Class(
                group=group,
                low=float(widths[one]),
                high=float(widths[one + 1]),
                powers=powers[one],
                weighted=weighted[one],
            )
            for one in range(number)
        ]

    def sector_means(
        self, sectors: Sectors, *, slope_error: float = 0.0, unknown: float = 0.0
    ) -> SectorMeans:
        """Means of the sectors; see `FewPixels.sector_means`."""
        if sectors.own_widths:
            sums = np.zeros((2, self._counts.size))
            for one in self._classes:
                sums[:, one.group] += one.sector_sums(sectors.level)
            delta, weighted = sums / self._counts
            largest = math.tanh(max(sectors.level + self.widest, 0.0))
        else:
            largest = math.tanh(sectors.level)
            delta, weighted = np.full(self._counts.size, largest), largest * self.group_means
        return SectorMeans(
            share=delta * (1 + slope_error) + slope_error,
            constant=weighted + unknown * delta,
            largest=largest,
        )

    def bend(self, rate: FloatArray, change: FloatArray, unknown: float) -> FloatArray:
        """Bound of the mean of ``(L + c) (rate / (L - c))^2``; see `FewPixels.bend`.

        It is convex in L: over classes of about the same L its mean is at most that of straight
        lines between their ends.

        Parameters
        ----------
        rate
            Of every group, shape (k,).
        change
            c, shape (k,).
        unknown
            Constant error of every luminosity.
        """
        if self._lights is None:
            self._lights = [self._lights_of(group) for group in range(self._counts.size)]
        means = []
        for (levels, shares), one, near in zip(self._lights, rate, change, strict=True):
            seen = levels + unknown
            means.append(float(shares @ ((seen + near) * (one / (seen - near)) ** 2)))
        return np.array(means)

    def _lights_of(self, group: int) -> tuple[FloatArray, FloatArray]:
        """Levels of light, and the share of the pixels at each: one between two counts in both."""
        least, most = self.least[group], self._most[group]
        number = math.ceil(math.log(most / least) / _LIGHT_STEP)
        levels = np.geomspace(least, most, number + 1)
        levels[-1] = most
        shares = np.zeros(number + 1)
        if not number:
            return levels, shares + 1
        for light, _ in self._blocks(group):
            which = np.searchsorted(levels[1:-1], light, side='right')
            along = (light - levels[which]) / (levels[which + 1] - levels[which])
            shares += np.bincount(which, 1 - along, number + 1)
            shares += np.bincount(which + 1, along, number + 1)
        return levels, shares / self._counts[group]
