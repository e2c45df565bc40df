"""The sector that the zero-order-hold estimate never leaves: Lemmas 1 to 4 of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds, threshold_step


def spacing(event_threshold: float, log_base: float) -> float:
    """``rho = b^-h`` in (0, 1), the spacing of the logarithmic partitions (paper, eq. 9).

    Parameters
    ----------
    event_threshold
        h > 0, in logarithms to the base b.
    log_base
        b > 1.

    Raises
    ------
    ParameterError
        If h is not positive and finite or b does not exceed 1.
    """
    return math.exp(-threshold_step(event_threshold, log_base))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sector:
    """Per-pixel constants of the estimator and of the bound on its error.

    Parameters
    ----------
    spacing
        ``rho = b^-h``.
    initial_reference
        ``qhat_i(0) = 2 m M / (M + m)``, shape (r,) (Lemma 1).
    initial_error
        ``delta_q = (M - m) / (M + m)``, shape (r,): bound on its relative error (Lemma 1).
    amplification
        ``lambda_i = (M + m) rho / (M + m rho^2)``, shape (r,) (Lemma 4).
    initial_estimate
        ``lambdabar_i = lambda_i qhat_i(0) = 2 m M rho / (M + m rho^2)``, shape (r,) (Theorem 3).
    error_bound
        ``delta_z = (M - m rho^2) / (M + m rho^2)``, shape (r,), of ``|z - y| <= delta_z |y|``
        (Lemma 4).
    """

    spacing: float
    initial_reference: FloatArray
    initial_error: FloatArray
    amplification: FloatArray
    initial_estimate: FloatArray
    error_bound: FloatArray


def sector(bounds: ReferenceBounds, *, event_threshold: float, log_base: float) -> Sector:
    """Constants of Lemmas 1 and 4 for every pixel.

    Parameters
    ----------
    bounds
        m and M of every pixel.
    event_threshold
        h > 0, in logarithms to the base b.
    log_base
        b > 1.

    Raises
    ------
    ParameterError
        If h or b is out of range.
    """
    rho = spacing(event_threshold, log_base)
    m, upper = bounds.lower, bounds.upper
    total = upper + m
    return Sector(
        spacing=rho,
        initial_reference=2 * m * upper / total,
        initial_error=(upper - m) / total,
        amplification=total * rho / (upper + m * rho * rho),
        initial_estimate=best_estimate(m, upper, on_spacing=rho, off_spacing=rho),
        error_bound=best_error(m, upper, on_spacing=rho, off_spacing=rho),
    )


def best_estimate(
    lower: FloatArray, upper: FloatArray, *, on_spacing: float, off_spacing: float
) -> FloatArray:
    """``2 m M rho_off / (M + m rho_on rho_off)``, the estimate of least worst relative error.

    A pixel with ``m <= q <= M`` that is silent has ``m rho_off < y < M / rho_on``; of such a y the
    harmonic mean of the ends is the best estimate (paper, Theorem 3, where both spacings are rho).

    Parameters
    ----------
    lower
        m, shape (r,).
    upper
        M, shape (r,).
    on_spacing
        ``rho_on = b^-h`` of the largest ON threshold.
    off_spacing
        ``rho_off = b^-h`` of the largest OFF threshold.
    """
    amplified = upper + lower * (on_spacing * off_spacing)
    return np.asarray(2 * lower * upper * off_spacing / amplified)


def best_error(
    lower: FloatArray, upper: FloatArray, *, on_spacing: float, off_spacing: float
) -> FloatArray:
    """``(M - m rho_on rho_off) / (M + m rho_on rho_off)``, worst error of `best_estimate`.

    Parameters
    ----------
    lower
        m, shape (r,).
    upper
        M, shape (r,).
    on_spacing
        ``rho_on``.
    off_spacing
        ``rho_off``.
    """
    shrunk = lower * (on_spacing * off_spacing)
    return np.asarray((upper - shrunk) / (upper + shrunk))


def estimate(
    constants: Sector,
    counts: np.ndarray,
    signs: np.ndarray,
    *,
    event_threshold: float,
    log_base: float,
) -> FloatArray:
    """Zero-order-hold estimate ``z_i = s_i lambdabar_i rho^(-N_i)`` (paper, eqs. 12 and 13).

    Integer counts, not a running product: sensor and estimator agree bit for bit for ever.

    Parameters
    ----------
    constants
        Constants of every pixel.
    counts
        N, sum of the polarities so far, integers of shape (r,).
    signs
        s, sign of the reference, +1 or -1, shape (r,); -1 only with a signed-log photoreceptor.
    event_threshold
        h, in logarithms to the base b.
    log_base
        b.
    """
    return (
        signs
        * constants.initial_estimate
        * np.exp(counts * threshold_step(event_threshold, log_base))
    )
