"""The problem that is left for every number of pixels: a measurement a group, its mean zbar."""

from __future__ import annotations

import numpy as np

from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.state_space import GeneralizedPlant, StateSpace


def reduced_plant(
    model: PlantModel,
    *,
    input_cost: float,
    process_noise: float,
    weight: StateSpace | None = None,
    output_weight: StateSpace | None = None,
) -> GeneralizedPlant:
    """Regularised generalized plant of the reduced problem.

    Performance is ``[x; input_cost u]``, disturbance ``[noise; w]``, measurement
    ``c'x + weight(s) w``, one for each pixel group. The paper's D12 = 0 and the missing
    process noise make its plant singular (paper, Remark 6); the two small terms regularise it.

    Parameters
    ----------
    model
        Plant.
    input_cost
        Cost on u, > 0, in the unit of x over that of u: rolls the loop off near
        ``||B|| / input_cost`` rad/s.
    process_noise
        Intensity of the noise on xdot, > 0, in the unit of xdot over that of y.
    weight
        Stable scalar weight V with V(inf) != 0 on w; 1 if left out, and of several groups.
    output_weight
        Stable scalar weight on the component of x along c; likewise.
    """
    if model.group_count > 1:
        return _of_groups(model, input_cost=input_cost, process_noise=process_noise)
    a, b, c = model.state_matrix, model.input_matrix, model.gradient
    n, m = b.shape
    v = weight or StateSpace.constant(1.0)
    o = output_weight or StateSpace.constant(1.0)
    unit = c / np.linalg.norm(c)
    across = np.eye(n) - np.outer(unit, unit)
    # States of the plant, of V and of the output weight.
    of_v, of_o, size = slice(n, n + v.order), slice(n + v.order, None), n + v.order + o.order
    states, noise, inputs = np.zeros((size, size)), np.zeros((size, n + 1)), np.zeros((size, m))
    states[:n, :n], states[of_v, of_v], states[of_o, of_o] = a, v.a, o.a
    states[of_o, :n] = o.b @ unit[None, :]
    noise[:n, :n], noise[of_v, n:], inputs[:n] = process_noise * np.eye(n), v.b, b
    costs, input_costs = np.zeros((n + m, size)), np.zeros((n + m, m))
    costs[:n, :n] = across + np.outer(unit, o.d @ unit[None, :])
    costs[:n, of_o] = unit[:, None] @ o.c
    input_costs[n:] = input_cost * np.eye(m)
    measured, measured_noise = np.zeros((1, size)), np.zeros((1, n + 1))
    measured[0, :n], measured[:, of_v], measured_noise[:, n:] = c, v.c, v.d
    return GeneralizedPlant(
        a=states, b1=noise, b2=inputs, c1=costs, c2=measured, d12=input_costs, d21=measured_noise
    )


def _of_groups(model: PlantModel, *, input_cost: float, process_noise: float) -> GeneralizedPlant:
    n, m, k = model.state_count, model.input_count, model.group_count
    return GeneralizedPlant(
        a=model.state_matrix,
        b1=np.hstack([process_noise * np.eye(n), np.zeros((n, k))]),
        b2=model.input_matrix,
        c1=np.vstack([np.eye(n), np.zeros((m, n))]),
        c2=model.gradients,
        d12=np.vstack([np.zeros((n, m)), input_cost * np.eye(m)]),
        d21=np.hstack([np.zeros((k, n)), np.eye(k)]),
    )
