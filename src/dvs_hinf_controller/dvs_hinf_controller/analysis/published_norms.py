"""The norms of the closed loop in which the paper states its theorems."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_hinf_controller.analysis.hinf_norm import hinf_norm
from dvs_hinf_controller.analysis.mu import mu_bounds
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import StateSpace


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedNorms:
    """Norms of the paper's generalized plant with all its pixels.

    Parameters
    ----------
    gamma
        ``||[Gw1, Gw2]||_inf``, an upper bound.
    mu_upper
        Upper bound of mu; not a number where there are several pixel groups.
    mu_lower
        Lower bound of mu, likewise.
    dc_gain_w1
        ``||Gw1(0)||``.
    dc_gain_w2
        ``||W Gw2(0)||``.
    hinf_gain_w1
        ``||Gw1||_inf``, an upper bound.
    """

    gamma: float
    mu_upper: float
    mu_lower: float
    dc_gain_w1: float
    dc_gain_w2: float
    hinf_gain_w1: float


def published_norms(problem: DesignProblem, g: StateSpace) -> PublishedNorms:
    """Norms of a stable loop.

    With one pixel group ``||Gw1|| = ||c|| ||G||`` and ``||Gw2|| = ||G||``. With several,
    the mean over the r_j pixels of group j passes a share ``1/sqrt(r_j)`` of a disturbance
    spread over them, and the r copies of x weigh ``sqrt(r)``: ``||G diag(sqrt(r/r_j))||``, and
    ``||c_j||`` with it for w1 (docs/pixel_groups.md).

    Parameters
    ----------
    problem
        Plant and pixels.
    g
        G, from the mean disturbances to x, a column a group.
    """
    model = problem.model
    static = g.response(np.zeros(1))[0]
    if model.group_count == 1:
        c_norm = float(np.linalg.norm(model.gradient))
        norm = hinf_norm(g)
        mu = mu_bounds(g, model.gradient)
        return PublishedNorms(
            gamma=math.sqrt(1 + c_norm**2) * norm.upper,
            mu_upper=mu.upper,
            mu_lower=mu.lower,
            dc_gain_w1=c_norm * float(np.linalg.norm(static)),
            dc_gain_w2=float(np.linalg.norm(problem.in_error_norm(np.abs(static)))),
            hinf_gain_w1=c_norm * norm.upper,
        )
    w2 = problem.group_scales
    w1 = w2 * np.linalg.norm(model.gradients, axis=1)
    both = np.sqrt(w1**2 + w2**2)
    return PublishedNorms(
        gamma=hinf_norm(replace(g, b=g.b * both)).upper,
        mu_upper=math.nan,
        mu_lower=math.nan,
        dc_gain_w1=float(np.linalg.norm(static.real * w1, 2)),
        dc_gain_w2=float(np.linalg.norm(problem.in_error_norm(static.real * w2), 2)),
        hinf_gain_w1=hinf_norm(replace(g, b=g.b * w1)).upper,
    )
