"""The paper's own generalized plant, to test the reduced problem against for a few pixels."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.state_space import GeneralizedPlant


def full_plant(
    model: PlantModel,
    pixel_count: int,
    *,
    performance_copies: int = 2,
    input_cost: float = 0.0,
    process_noise: float = 0.0,
) -> GeneralizedPlant:
    """Generalized plant P (paper, eq. 23), regularised where asked.

    Disturbances are w1 (n r entries) and w2 (r), performance is r stacked copies of x, twice,
    measurements are the r deviations zbar. Its size grows with r; `reduced_plant` does not.

    Parameters
    ----------
    model
        Plant.
    pixel_count
        r.
    performance_copies
        2 as in eq. 23; 1 for unstructured synthesis, the second row removed (section IV.A).
    input_cost
        Weight of u as a further performance, in the unit of x over that of u; 0 leaves it out.
    process_noise
        Weight of a further disturbance on xdot, in the unit of xdot over that of y; 0 leaves it
        out.
    """
    a, b, c = model.state_matrix, model.input_matrix, model.gradient[None, :]
    n, m = b.shape
    r = pixel_count
    copies = np.vstack([np.eye(n)] * (r * performance_copies))
    b1 = np.zeros((n, n * r + r))
    d21 = np.hstack([scipy.linalg.block_diag(*[c] * r), np.eye(r)])
    c1, d12 = copies, np.zeros((copies.shape[0], m))
    if input_cost > 0:
        c1, d12 = np.vstack([c1, np.zeros((m, n))]), np.vstack([d12, input_cost * np.eye(m)])
    if process_noise > 0:
        b1 = np.hstack([b1, process_noise * np.eye(n)])
        d21 = np.hstack([d21, np.zeros((r, n))])
    return GeneralizedPlant(a=a, b1=b1, b2=b, c1=c1, c2=np.vstack([c] * r), d12=d12, d21=d21)
