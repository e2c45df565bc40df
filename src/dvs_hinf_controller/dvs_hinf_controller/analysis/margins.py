"""Gain, phase and delay margins of the mean channel: how wrong may plant and timing be?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.mu import log_grid
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import StateSpace

_POINTS_PER_DECADE = 400
_REAL = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Classical margins of the loop broken at the mean of zbar (Astrom and Murray 2008, ch. 9.3).

    Parameters
    ----------
    gain_up
        Factor above 1 up to which the loop gain may rise; infinite if no crossing bounds it.
    gain_down
        Factor below 1 down to which it may fall; zero if no crossing bounds it.
    phase
        Smallest phase margin, rad; infinite if the gain is 1 nowhere.
    delay
        Smallest ``phase / frequency`` of all gain crossings, s; infinite likewise.
    """

    gain_up: float
    gain_down: float
    phase: float
    delay: float


def margins(model: PlantModel, controller: LinearController) -> Margins:
    """Margins of ``L = -c' (sI - A)^-1 B K(s)``, on a dense frequency grid.

    Parameters
    ----------
    model
        Plant.
    controller
        K, stabilizing.
    """
    plant = StateSpace(
        a=model.state_matrix,
        b=model.input_matrix,
        c=model.gradient[None, :],
        d=np.zeros((1, model.input_count)),
    )
    poles = np.concatenate([plant.poles(), np.linalg.eigvals(controller.state_matrix)])
    w = log_grid(poles, points_per_decade=_POINTS_PER_DECADE)[1:] * (1 + 1e-9)
    loop = -np.einsum('fij,fj->f', plant.response(w), controller.response(w))
    phase = np.unwrap(np.angle(loop))
    size = np.log(np.abs(loop) + 1e-300)
    turns = np.floor((phase + math.pi) / (2 * math.pi))
    at_minus_one = np.flatnonzero(np.diff(turns) != 0)
    gains = np.exp(-(size[at_minus_one] + size[at_minus_one + 1]) / 2)
    if loop[0].real < 0 and abs(loop[0].imag) < _REAL * abs(loop[0]):  # a crossing at w = 0
        gains = np.append(gains, 1 / abs(loop[0]))
    crossings = np.flatnonzero(np.diff(np.sign(size)) != 0)
    ahead = np.mod(phase[crossings] + math.pi, 2 * math.pi)
    return Margins(
        gain_up=float(gains[gains > 1].min(initial=math.inf)),
        gain_down=float(gains[gains < 1].max(initial=0.0)),
        phase=float(np.minimum(ahead, 2 * math.pi - ahead).min(initial=math.inf)),
        delay=float((ahead / w[crossings]).min(initial=math.inf)),
    )
