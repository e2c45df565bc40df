"""What every run is measured by: the error, the sector ratio, and what passes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import Equilibrium
from dvs_common.scenario.scenario import Scenario

# The limit superior is read from the last third of a run.
_SETTLED = 2 / 3
# Rounding of log, exp and the thresholds; the sector bound itself leaves no room.
_SECTOR_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What decides on a run.

    Parameters
    ----------
    tolerance
        eps.
    limsup_error
        Largest error of the settled part of the run, or a bound on it.
    sector_ratio_max
        Largest sector ratio of the run.
    """

    tolerance: float
    limsup_error: float
    sector_ratio_max: float

    @property
    def regulated(self) -> bool:
        """Whether the error stayed below the tolerance."""
        return regulated(self.limsup_error, self.tolerance)

    @property
    def sector_held(self) -> bool:
        """Whether the bound of Lemma 4 held at every sample."""
        return self.sector_ratio_max <= 1 + _SECTOR_ROUNDING

    @property
    def passed(self) -> bool:
        """Whether the run regulated and the sector bound held."""
        return self.regulated and self.sector_held


def regulated(limsup_error: float, tolerance: float) -> bool:
    """Whether the error of a settled run stayed below the tolerance (paper, Problem 1).

    Parameters
    ----------
    limsup_error
        Largest error of the settled part of the run, or a bound on it.
    tolerance
        eps.
    """
    return limsup_error < tolerance


def settled_from(duration_s: float) -> float:
    """Instant from which a run counts as settled, s.

    Parameters
    ----------
    duration_s
        Length of the run, s.
    """
    return duration_s * _SETTLED


def error(states: FloatArray, equilibrium: Equilibrium) -> FloatArray:
    """``||x - x_d||`` of every state, shape (k,), in the unit of x.

    x_d is the equilibrium that the controller regulates to, not `set_point` as it was written:
    that need not be a point that the plant can hold (paper, below eq. 2).

    Parameters
    ----------
    states
        x, shape (k, n).
    equilibrium
        x_d.
    """
    return np.asarray(np.linalg.norm(states - equilibrium.state, axis=-1))


def sector_ratio(
    luminosities: FloatArray, estimates: FloatArray, *, error_bound: ArrayLike, dead_band: float
) -> FloatArray:
    """``|z - y| / (delta_z |y|)``, shape (k, r): at most 1 as long as Lemma 4 holds.

    Not a number within the dead band, which Lemma 4 does not cover.

    Parameters
    ----------
    luminosities
        y, shape (k, r).
    estimates
        z, shape (k, r).
    error_bound
        delta_z, shape (r,), or 1 for the relative error itself.
    dead_band
        Least ``|y|`` of a pixel that is not silent; 0 for pixels without a dead band.
    """
    y, missed = np.abs(luminosities), np.abs(estimates - luminosities)
    # No estimate is in the sector of y = 0: the ratio is infinite there.
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        ratio = missed / (np.asarray(error_bound) * y)
    return np.where((y >= dead_band) & (missed > 0), ratio, np.where(y >= dead_band, 0.0, np.nan))


def largest(ratios: FloatArray) -> float:
    """Largest sector ratio, 0 if all pixels were silent all the time.

    Parameters
    ----------
    ratios
        Of `sector_ratio`.
    """
    return float(np.fmax.reduce(ratios, axis=None, initial=0.0))


def silent_below(scenario: Scenario) -> float:
    """Dead band of the pixels of a scenario, 0 where they have none.

    Parameters
    ----------
    scenario
        Parameters of the run.
    """
    sensor = scenario.sensor
    return float(sensor.dead_band) if sensor.photoreceptor == 'signed_log' else 0.0
