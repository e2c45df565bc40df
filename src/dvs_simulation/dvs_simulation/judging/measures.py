"""What every run is measured by: the error, the sector ratio, and what passes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import Equilibrium
from dvs_common.scenario.scenario import Scenario

# The limit superior is read from the last third of a run.
_SETTLED = 2 / 3
# Rounding of log, exp and the thresholds; bounds themselves leave no room.
ROUNDING = 1e-9


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
    output_tolerance
        Tolerance of ``|c'(x - x_d)|``; infinite for none.
    limsup_output
        Largest ``|c'(x - x_d)|`` of the settled part of the run.
    """

    tolerance: float
    limsup_error: float
    sector_ratio_max: float
    output_tolerance: float = math.inf
    limsup_output: float = 0.0

    @property
    def regulated(self) -> bool:
        """Whether error and output stayed below their tolerances."""
        return regulated(self.limsup_error, self.tolerance) and regulated(
            self.limsup_output, self.output_tolerance
        )

    @property
    def sector_held(self) -> bool:
        """Whether the bound of Lemma 4 held at every sample."""
        return bool(kept(self.sector_ratio_max))

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


def kept(ratios: ArrayLike) -> NDArray[np.bool_]:
    """Whether ratios of what came to its bound are at most 1, but for rounding; NaN is not.

    Parameters
    ----------
    ratios
        Of any shape: sector ratios, or errors over the error that was promised.
    """
    return np.asarray(ratios) <= 1 + ROUNDING


def settled_from(duration_s: float) -> float:
    """Instant from which a run counts as settled, s.

    Parameters
    ----------
    duration_s
        Length of the run, s.
    """
    return duration_s * _SETTLED


def unsettled(limsup_error: float, tolerance: float, *, transient: float) -> bool:
    """Whether what the start leaves accounts for an error above the tolerance.

    It counts twice: the estimate errs by more while the state is far.

    Parameters
    ----------
    limsup_error
        Largest error of the part of the run that should have settled.
    tolerance
        eps.
    transient
        Largest error in that part that the start alone leaves.
    """
    return limsup_error < tolerance + 2 * transient


def error(
    states: FloatArray, equilibrium: Equilibrium, weights: FloatArray | None = None
) -> FloatArray:
    """``||W (x - x_d)||`` of every state, shape (k,).

    x_d is the equilibrium that the controller regulates to, not `set_point` as it was written:
    that need not be a point that the plant can hold (paper, below eq. 2).

    Parameters
    ----------
    states
        x, shape (k, n).
    equilibrium
        x_d.
    weights
        Diagonal of W, shape (n,); None for all 1.
    """
    return size_of(states - equilibrium.state, weights)


def size_of(deviations: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """``||W x||`` of every deviation from the equilibrium, shape (k,).

    Parameters
    ----------
    deviations
        x - x_d, shape (k, n).
    weights
        Diagonal of W, shape (n,); None for all 1.
    """
    weighed = deviations if weights is None else deviations * weights
    return np.asarray(np.linalg.norm(weighed, axis=-1))


def output_error(
    states: FloatArray, equilibrium: Equilibrium, output_vector: FloatArray
) -> FloatArray:
    """``|c'(x - x_d)|`` of every state, shape (k,), in the unit of y; the largest of all groups.

    Parameters
    ----------
    states
        x, shape (k, n).
    equilibrium
        x_d.
    output_vector
        c, shape (n,), or a row a group.
    """
    outputs = np.abs((states - equilibrium.state) @ output_vector.T)
    return np.asarray(outputs.max(axis=-1) if output_vector.ndim == 2 else outputs)


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
