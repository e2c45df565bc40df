"""What thresholds and promises take of the pixels: sums over all of them."""

from __future__ import annotations

import math

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.many_pixels import ManyPixels
from dvs_hinf_controller.sector_means import SectorMeans, Sectors, SeenPixels

# Pixels up to which each is looked at.
_FEW = 4096


class FewPixels:
    """Looks at each pixel.

    Parameters
    ----------
    seen
        Pixels at the set-point.

    Attributes
    ----------
    rms
        ``||D|| / sqrt(r)`` of the luminosities at the set-point.
    mean
        Mean of ``|D_i|``.
    group_means
        The same of every group, shape (k,).
    least
        ``min |D_i|`` of every group, shape (k,).
    worst_ratio
        ``min m_i / M_i``.
    widest
        ``max w_i``.
    """

    def __init__(self, seen: SeenPixels) -> None:
        scene, bounds = seen.scene, seen.bounds
        self._groups, self._count = scene.groups, seen.model.group_count
        luminosity = scene.luminosity(seen.model, seen.state)
        self._levels = np.abs(luminosity)
        self._widths = 0.5 * np.log(bounds.upper / bounds.lower)
        self.rms = float(np.sqrt(np.mean(luminosity**2)))
        self.mean = float(np.mean(self._levels))
        self.group_means = self._means(self._levels)
        self.least = np.array([one.min() for one in self._by_group(self._levels)])
        self.worst_ratio = float(np.min(bounds.lower / bounds.upper))
        self.widest = float(self._widths.max())

    def sector_means(
        self, sectors: Sectors, *, slope_error: float = 0.0, unknown: float = 0.0
    ) -> SectorMeans:
        """Means of the sectors.

        Parameters
        ----------
        sectors
            delta_i.
        slope_error
            e; see `SectorMeans`.
        unknown
            Constant error of every luminosity.
        """
        if sectors.own_widths:
            delta = np.tanh(np.maximum(sectors.level + self._widths, 0.0))
        else:
            delta = np.full(self._widths.size, math.tanh(sectors.level))
        return SectorMeans(
            share=self._means(delta * (1 + slope_error) + slope_error),
            constant=self._means(delta * (self._levels + unknown)),
            largest=float(delta.max()),
        )

    def bend(self, rate: FloatArray, change: FloatArray, unknown: float) -> FloatArray:
        """Mean of ``(L + c) (rate / (L - c))^2`` with ``L = |D_i| + unknown``, shape (k,).

        Parameters
        ----------
        rate
            Of every group, shape (k,).
        change
            c of every group, less than each of its L, shape (k,).
        unknown
            Constant error of every luminosity.
        """
        levels = self._levels + unknown
        near = change[0] if self._groups is None else change[self._groups]
        steep = rate[0] if self._groups is None else rate[self._groups]
        return self._means((levels + near) * (steep / (levels - near)) ** 2)

    def _by_group(self, values: FloatArray) -> list[FloatArray]:
        if self._groups is None:
            return [values]
        return [values[self._groups == one] for one in range(self._count)]

    def _means(self, values: FloatArray) -> FloatArray:
        return np.array([one.mean() for one in self._by_group(values)])


PixelSums = FewPixels | ManyPixels


def pixel_sums(seen: SeenPixels) -> PixelSums:
    """Sums over the pixels of a scene.

    Parameters
    ----------
    seen
        Pixels at the set-point.
    """
    return (FewPixels if seen.scene.pixel_count <= _FEW else ManyPixels)(seen)
