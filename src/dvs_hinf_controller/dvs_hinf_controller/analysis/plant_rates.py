"""Rates of a plant: how fast it is, and how fast it must be controlled."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from dvs_common.scenario.model import PlantModel

_NO_RATE = 1e-9
# Rounding moves the modes of a chain of three integrators by the cube root of its size.
_ROUNDED = 1e-4


def plant_rate(model: PlantModel) -> float:
    """The plant's own rate, its fastest mode, rad/s.

    That of a chain of integrators is the norm of A in balanced units; without any dynamics
    (A = 0) it is 1 rad/s.

    Parameters
    ----------
    model
        Plant.
    """
    rate = float(np.max(np.abs(np.linalg.eigvals(model.state_matrix))))
    # In balanced units: those of the states have no part in it.
    balanced = scipy.linalg.matrix_balance(model.state_matrix, permute=False)[0]
    size = float(np.linalg.norm(balanced, 2))
    if rate > _ROUNDED * size:
        return rate
    return size if size > 0 else 1.0


def control_rate(model: PlantModel) -> float:
    """Rate at which the plant must be controlled: its fastest unstable mode, rad/s.

    A stable plant's slowest mode; a fast stable mode needs nothing. The `plant_rate` where no
    such mode has a rate.

    Parameters
    ----------
    model
        Plant.
    """
    whole = plant_rate(model)
    modes = np.linalg.eigvals(model.state_matrix)
    rates = np.abs(modes)
    unstable = rates[(modes.real > -_NO_RATE * whole) & (rates > _NO_RATE * whole)]
    if unstable.size:
        return float(unstable.max())
    moving = rates[rates > _NO_RATE * whole]
    return float(moving.min()) if moving.size else whole
