"""Controllers of lower order by truncation of states that the closed loop hardly uses."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import lyapunov_solution, state_response

_JITTER = 1e-13


def reduced_controllers(model: PlantModel, controller: LinearController) -> list[LinearController]:
    """Truncations of every order 0, 1, ..., k - 1, not all of them stabilizing.

    K's states are balanced within the closed loop: by how much w moves them, and how much they
    move x (Anderson and Liu 1989; Obinata and Anderson 2001, chapter 3).

    Parameters
    ----------
    model
        Plant.
    controller
        K, stabilizing.
    """
    g = state_response(model, controller)
    n = model.state_count
    reach = lyapunov_solution(g.a, -g.b @ g.b.T)[n:, n:]
    observe = lyapunov_solution(g.a.T, -g.c.T @ g.c)[n:, n:]
    left, right = _root(observe), _root(reach)
    u, values, vt = np.linalg.svd(left.T @ right)
    scale = 1 / np.sqrt(values)
    into, out = (left @ u * scale).T, right @ vt.T * scale
    a = into @ controller.state_matrix @ out
    b, c = into @ controller.input_vector, controller.output_matrix @ out
    return [
        LinearController(
            state_matrix=a[:order, :order],
            input_vector=b[:order],
            output_matrix=c[:, :order],
            feedthrough=controller.feedthrough,
        )
        for order in range(controller.order)
    ]


def _root(gramian: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    floor = max(float(values[-1]), 1e-300) * _JITTER
    return np.asarray(vectors * np.sqrt(np.maximum(values, floor)))
