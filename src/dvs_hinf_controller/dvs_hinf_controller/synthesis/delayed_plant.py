"""A plant whose commands act late, with the delay as a rational system."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from dvs_common.scenario.model import PlantModel


def delayed_plant(model: PlantModel, delay: float) -> PlantModel:
    """Plant with the second-order Pade approximation of a delay before every input.

    ``exp(-s d) = (1 - s d/2 + (s d)^2/12) / (1 + s d/2 + (s d)^2/12)`` (Franklin, Powell and
    Emami-Naeini 2010, section 5.6.3). The states of the plant come first.

    Parameters
    ----------
    model
        Plant.
    delay
        d > 0, s.
    """
    n, m = model.state_count, model.input_count
    # 1 - 12 p s / (s^2 + 6 p s + 12 p^2) with p = 1/d.
    p = 1 / delay
    filter_matrix = p * np.array([[0.0, 1.0], [-12.0, -6.0]])
    filter_input, filter_output = p * np.array([0.0, 1.0]), np.array([0.0, -12.0])
    a = scipy.linalg.block_diag(model.state_matrix, *[filter_matrix] * m)
    b = np.vstack([model.input_matrix, np.zeros((2 * m, m))])
    for j in range(m):
        own = slice(n + 2 * j, n + 2 * j + 2)
        a[:n, own] = np.outer(model.input_matrix[:, j], filter_output)
        b[own, j] = filter_input
    return PlantModel(
        state_matrix=a,
        input_matrix=b,
        output_vector=np.concatenate([model.gradient, np.zeros(2 * m)]),
    )
