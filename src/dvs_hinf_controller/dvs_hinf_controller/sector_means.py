"""Sectors of all pixels, and their means."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds


@dataclass(frozen=True, slots=True, kw_only=True)
class Sectors:
    """Sectors ``delta_i = tanh(level + w_i)`` of all pixels, or a common one without the w_i.

    Parameters
    ----------
    level
        ``h ln b``, or ``artanh(delta)`` of a common sector.
    own_widths
        Whether ``w_i = ln(M_i / m_i) / 2`` of every pixel comes on top.
    """

    level: float
    own_widths: bool = True

    @classmethod
    def common(cls, delta: float) -> Sectors:
        """The same sector for every pixel.

        Parameters
        ----------
        delta
            In [0, 1).
        """
        return cls(level=math.atanh(delta), own_widths=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenPixels:
    """Pixels at the set-point, of which sums are taken.

    Parameters
    ----------
    scene
        Pixels and their groups.
    model
        What they see.
    state
        Set-point.
    bounds
        m and M of every pixel.
    """

    scene: PixelScene
    model: PlantModel
    state: FloatArray
    bounds: ReferenceBounds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SectorMeans:
    """Means over the pixels of every group.

    Parameters
    ----------
    share
        Of ``delta_i (1 + e) + e``, e being the slope error, shape (k,).
    constant
        Of ``delta_i (|D_i| + unknown)``, shape (k,).
    largest
        ``max delta_i``.
    """

    share: FloatArray
    constant: FloatArray
    largest: float
