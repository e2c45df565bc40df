"""Event thresholds as published (Theorems 1 and 2)."""

from __future__ import annotations

import math

from dvs_hinf_controller.problem import DesignProblem


def published_uncertainty(
    problem: DesignProblem, *, dc_gain_w1: float, dc_gain_w2: float
) -> float:
    """``delta* = eps / (||Gw2(0)|| ||D||/sqrt(r) + eps ||Gw1(0)||)`` (paper, Theorem 1).

    It argues with final values, as if the sector's Delta were constant; infinite if both gains
    are zero.

    Parameters
    ----------
    problem
        Tolerance and luminosities.
    dc_gain_w1
        ``||Gw1(0)|| = ||c|| ||G(0)||``.
    dc_gain_w2
        ``||Gw2(0)|| = ||G(0)||``.
    """
    gain = dc_gain_w2 * problem.rms_luminosity + problem.tolerance * dc_gain_w1
    return problem.tolerance / gain if gain > 0 else math.inf


def event_threshold(problem: DesignProblem, uncertainty: float) -> float:
    """Largest h whose sector stays within `uncertainty` (paper, Theorem 2).

    ``h = log_b sqrt(min_i(m_i/M_i) (1 + delta) / (1 - delta))``.

    Parameters
    ----------
    problem
        Reference bounds and base.
    uncertainty
        delta >= 0; the sector's error never reaches 1, so that h is infinite from there on.

    Returns
    -------
    float
        h, in logarithms to the base b. Zero or negative: no threshold is fine enough, since q(0)
        is known too poorly.
    """
    if uncertainty >= 1:
        return math.inf
    ratio = problem.worst_reference_ratio * (1 + uncertainty) / (1 - uncertainty)
    return 0.5 * math.log(ratio) / math.log(problem.log_base)


def small_gain_holds(uncertainty: float, hinf_gain_w1: float) -> bool:
    """Whether ``delta ||Gw1||_inf < 1``: the loop is stable for every Delta of that size.

    The paper's Theorem 1 checks it at zero frequency only, where its formula implies it.

    Parameters
    ----------
    uncertainty
        delta.
    hinf_gain_w1
        ``||Gw1||_inf``, an upper bound.
    """
    return bool(min(uncertainty, 1.0) * hinf_gain_w1 < 1)
