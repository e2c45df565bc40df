"""Margins of loops whose crossings are known in closed form."""

import math

import numpy as np
import pytest

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.margins import margins
from dvs_hinf_controller.controller import LinearController


def static(gain: float) -> LinearController:
    return LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((1, 0)),
        feedthrough=np.array([gain]),
    )


def test_an_unstable_plant_bounds_the_gain_from_below() -> None:
    """L = 3 / (s - 1): stable down to a third; |L| = 1 at sqrt(8), phase margin atan(sqrt(8))."""
    plant = PlantModel(
        state_matrix=np.ones((1, 1)), input_matrix=np.ones((1, 1)), output_vector=np.ones(1)
    )
    found = margins(plant, static(-3.0))

    assert found.gain_up == math.inf
    assert found.gain_down == pytest.approx(1 / 3, rel=0.02)
    assert found.phase == pytest.approx(math.atan(math.sqrt(8)), rel=0.02)
    assert found.delay == pytest.approx(math.atan(math.sqrt(8)) / math.sqrt(8), rel=0.02)


def test_three_lags_bound_the_gain_from_above() -> None:
    """L = k / (s + 1)^3 crosses -1 at k = 8, w = sqrt(3)."""
    chain = -np.eye(3) + np.diag([1.0, 1.0], 1)
    plant = PlantModel(
        state_matrix=chain,
        input_matrix=np.array([[0.0], [0.0], [1.0]]),
        output_vector=np.array([1.0, 0.0, 0.0]),
    )
    found = margins(plant, static(-2.0))

    assert found.gain_up == pytest.approx(4.0, rel=0.02)
    assert found.gain_down == 0
