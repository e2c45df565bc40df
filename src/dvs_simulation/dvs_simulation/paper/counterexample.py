"""A loop that the published theorems allow and that leaves its tolerance all the same.

Theorem 1 argues with final values, as if the sector's Delta were constant; it jumps at events.
A controller with a small gain at zero frequency and a large one above makes the most of that: it
minimises ``|| [T; V T; 0.01 u] ||`` with ``V(s) = (s + 3) / (s + 0.3)`` (docs/theory.md).
"""

from __future__ import annotations

import numpy as np

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import GeneralizedPlant
from dvs_hinf_controller.synthesis.hinf_synthesis import hinf_synthesis

WEIGHT_ZERO = 3.0
WEIGHT_POLE = 0.3
INPUT_COST = 0.01
PROCESS_NOISE = 1e-3
# Close to the optimum: a per cent away from it the limit cycle is already a gentler one.
_SLACK = 1e-4


def misled_controller(model: PlantModel) -> LinearController:
    """Controller with a low gain at zero frequency, by H-infinity synthesis.

    Parameters
    ----------
    model
        Plant of the mirror example.

    Raises
    ------
    SynthesisError
        If the plant allows no controller.
    """
    k = hinf_synthesis(_generalized_plant(model), slack=_SLACK).controller
    return LinearController(
        state_matrix=k.a, input_vector=k.b[:, 0], output_matrix=k.c, feedthrough=k.d[:, 0]
    )


def _generalized_plant(model: PlantModel) -> GeneralizedPlant:
    a, b, c = model.state_matrix, model.input_matrix, model.gradient
    n, m = b.shape
    # V = 1 + (zero - pole) / (s + pole), with one state fed by c'x.
    states = np.zeros((n + 1, n + 1))
    states[:n, :n] = a
    states[n, :n] = (WEIGHT_ZERO - WEIGHT_POLE) * c
    states[n, n] = -WEIGHT_POLE
    performance = np.zeros((2 + m, n + 1))
    performance[0, :n] = c
    performance[1, :n] = c
    performance[1, n] = 1.0
    return GeneralizedPlant(
        a=states,
        b1=np.vstack([np.hstack([PROCESS_NOISE * np.eye(n), np.zeros((n, 1))]), np.zeros(n + 1)]),
        b2=np.vstack([b, np.zeros((1, m))]),
        c1=performance,
        c2=np.append(c, 0.0)[None, :],
        d12=np.vstack([np.zeros((2, m)), INPUT_COST * np.eye(m)]),
        d21=np.append(np.zeros(n), 1.0)[None, :],
    )
