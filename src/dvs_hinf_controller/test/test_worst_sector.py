"""The worst error within the sector, by its adjoint, beside the certificate that bounds it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.design import Design, design_from_scenario
from dvs_hinf_controller.state_space import state_response

STEP_S, DIRECTIONS = 1e-3, 90
MIRROR = load_scenario(Path(__file__).resolve().parents[3] / 'config' / 'mirror_r1.yaml')


def worst_error(design: Design, delta: float) -> float:
    """Largest ``v'x`` that any ``|Delta(t)| <= delta`` brings about in the continuous loop.

    ``x' = a x + b Delta (c'x + D)`` with light, ``c'x + D > 0``: by the maximum principle Delta is
    ``delta sign(p'b)`` with the adjoint ``-p' = (a + b Delta c)'p`` that ends in v, and the error
    is ``delta D`` times the integral of ``|p'b|``.
    """
    g = state_response(design.problem.model, design.controller)
    output = design.problem.model.gradient @ g.c
    b, feedback = g.b[:, 0], delta * np.outer(g.b[:, 0], output)
    rising = scipy.linalg.expm((g.a + feedback).T * STEP_S)
    falling = scipy.linalg.expm((g.a - feedback).T * STEP_S)
    angles = np.linspace(0, math.pi, DIRECTIONS, endpoint=False)
    adjoint = g.c.T @ np.array([np.cos(angles), np.sin(angles)])
    along: FloatArray = b @ adjoint
    total = np.abs(along) / 2
    for _ in range(int(10 / -g.abscissa / STEP_S)):
        adjoint = np.where(along > 0, rising @ adjoint, falling @ adjoint)
        along = b @ adjoint
        total += np.abs(along)
    return delta * design.problem.mean_luminosity * STEP_S * float(total.max())


@pytest.mark.parametrize(('method', 'share'), [('unstructured', 0.838), ('structured', 0.843)])
def test_at_the_certified_threshold_no_error_within_the_sector_leaves_eps(method, share):
    """The share is what docs/promise.md has."""
    design = design_from_scenario(MIRROR.replace(method=method))
    problem = design.problem
    delta = math.tanh(design.figures.h_certified_continuous + problem.pixels.widest)

    assert worst_error(design, delta) / problem.tolerance == pytest.approx(share, abs=3e-3)
