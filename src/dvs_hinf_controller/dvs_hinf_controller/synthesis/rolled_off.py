"""H-infinity synthesis of the reduced problem, as slow as the slack allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.plant_rates import control_rate, plant_rate
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import GeneralizedPlant, StateSpace, state_response
from dvs_hinf_controller.synthesis.hinf_synthesis import (
    HinfSynthesis,
    gamma_test,
    hinf_synthesis,
    hinf_synthesis_at,
)
from dvs_hinf_controller.synthesis.one_pixel_plant import reduced_plant
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError
from dvs_hinf_controller.synthesis.units import Units

# Roll-offs that are tried, relative to the plant's own rate.
_FASTEST = (1e4, 1e3, 1e2)
_SLOWEST = 0.1
_BANDWIDTH_RTOL = 0.05
_GAMMA_RTOL = 1e-5
# Factors on the process noise that are tried while they lower the norm by more than the slack.
_QUIETER = (0.1, 0.01)
# Where the bandwidth limit binds: factors on the process noise, and the decay that suffices.
_NOISE_SCALES = (1.0, 10.0, 30.0, 100.0)
_LEAST_DECAY = 0.05
# Below this share of the plant a link is rounding.
_ROUNDING = 1e-12
# Failures that no other roll-off mends.
_STRUCTURAL = (Assumption.STABILIZABILITY, Assumption.DETECTABILITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class RolledOff:
    """A controller and the level of the weighted problem that it guarantees.

    Parameters
    ----------
    controller
        K on the mean of zbar.
    gamma
        Level of the weighted, regularised problem that K stays below.
    gamma_optimal
        Least level without a noticeable roll-off.
    bandwidth
        Roll-off frequency that was used, rad/s.
    """

    controller: LinearController
    gamma: float
    gamma_optimal: float
    bandwidth: float


def synthesize_rolled_off(
    model: PlantModel,
    options: DesignOptions,
    *,
    weight: StateSpace | None = None,
    output_weight: StateSpace | None = None,
) -> RolledOff:
    """Controller within the slack of the optimum, as slow as the slack allows.

    The roll-off is a cost on u that meets the cost on x at ``bandwidth``. One half of the slack
    pays for it, the other keeps the central controller away from the singular optimum.

    Parameters
    ----------
    model
        Plant.
    options
        Slack, limit of the bandwidth, process noise.
    weight
        Scalar weight on w; see `reduced_plant`.
    output_weight
        Scalar weight on c'x; see `reduced_plant`.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable, or double precision does not suffice.
    """
    rate = plant_rate(model)
    noise = (
        options.process_noise * control_rate(model) / float(np.linalg.norm(model.output_vector))
    )
    gain = max(float(np.linalg.norm(model.input_matrix, 2)), 1e-300)

    def regularised(bandwidth: float, *, noise_scale: float = 1.0) -> GeneralizedPlant:
        return reduced_plant(
            model,
            input_cost=gain / bandwidth,
            process_noise=noise * noise_scale,
            weight=weight,
            output_weight=output_weight,
        )

    plant: Callable[[float], GeneralizedPlant] = regularised
    rates = [rate, control_rate(model)]
    fastest, optimal = _least_gamma(plant, rates, options.gamma_slack)
    for scale in _QUIETER:
        try:
            quieter = partial(regularised, noise_scale=scale)
            found = _least_gamma(quieter, rates, options.gamma_slack, near=optimal)
        except SynthesisError:
            break
        if found[1] > optimal * (1 - 2 * options.gamma_slack):
            break
        plant, (fastest, optimal) = quieter, found
    level = optimal * (1 + options.gamma_slack / 2)
    bandwidth = _slowest(
        lambda trial: gamma_test(plant(trial), level).failure is None,
        _SLOWEST * rate if fastest > rate else fastest / _FASTEST[0],
        fastest,
    )
    trials: Iterable[HinfSynthesis]
    if 0 < options.bandwidth_limit < bandwidth:
        bandwidth = options.bandwidth_limit
        trials = (
            hinf_synthesis(
                regularised(bandwidth, noise_scale=scale), slack=options.gamma_slack / 2
            )
            for scale in _NOISE_SCALES
        )
    else:
        trials = [hinf_synthesis_at(plant(bandwidth), optimal * (1 + options.gamma_slack))]
    controller, gamma = _fast_enough(model, trials, _LEAST_DECAY * rate)
    return RolledOff(
        controller=controller, gamma=gamma, gamma_optimal=optimal, bandwidth=bandwidth
    )


def synthesize_unstructured(model: PlantModel, options: DesignOptions) -> LinearController:
    """Controller of (nearly) the least ``sup_w ||G(jw)||`` (paper, section IV.A).

    Parameters
    ----------
    model
        Plant.
    options
        Slack, limit of the bandwidth, process noise.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable, or double precision does not suffice.
    """
    units = Units.of(model)
    return units.controller(
        synthesize_rolled_off(units.plant(model), units.options(options)).controller
    )


def as_controller(synthesis: HinfSynthesis) -> LinearController:
    """K as a `LinearController`.

    Parameters
    ----------
    synthesis
        Result of `hinf_synthesis` on a reduced plant.
    """
    k = synthesis.controller
    if k.d.shape[1] > 1:
        return LinearController(
            state_matrix=k.a, input_vector=k.b, output_matrix=k.c, feedthrough=k.d
        )
    return LinearController(
        state_matrix=k.a, input_vector=k.b[:, 0], output_matrix=k.c, feedthrough=k.d[:, 0]
    )


def _least_gamma(
    plant: Callable[[float], GeneralizedPlant],
    rates: list[float],
    slack: float,
    near: float | None = None,
) -> tuple[float, float]:
    """Fastest roll-off that double precision bears, and the least gamma there.

    Multiples of the plant's own rate come first; those of the rate of control, where a fast stable
    mode sets the former.
    """
    found = SynthesisError(Assumption.CONFIRMATION, 'no roll-off was tried')
    bandwidths = dict.fromkeys(multiple * rate for rate in rates for multiple in _FASTEST)
    for bandwidth in bandwidths:
        try:
            synthesis = hinf_synthesis(plant(bandwidth), slack=slack, rtol=_GAMMA_RTOL, near=near)
        except SynthesisError as error:
            if error.assumption in _STRUCTURAL:
                raise
            found = error
        else:
            return bandwidth, synthesis.gamma_optimal
    raise _badly_conditioned(plant(rates[0]), found)


def _badly_conditioned(plant: GeneralizedPlant, found: SynthesisError) -> SynthesisError:
    """The failure in terms of the unstable mode that u reaches, or y shows, least (Hautus)."""
    reach, mode = _least_margin(plant.a, plant.b2)
    sight, unseen = _least_margin(plant.a.T, plant.c2.T)
    if reach < _ROUNDING:
        return SynthesisError(
            Assumption.STABILIZABILITY,
            f'u does not reach the unstable mode s = {mode:.6g}, but for rounding ({reach:.1g})',
        )
    if sight < _ROUNDING:
        return SynthesisError(
            Assumption.DETECTABILITY,
            f'y does not show the unstable mode s = {unseen:.6g}, but for rounding ({sight:.1g})',
        )
    return SynthesisError(
        Assumption.CONFIRMATION,
        'the plant is too badly conditioned for double precision: relative to the size of A, u '
        f'reaches its unstable mode s = {mode:.6g} by {reach:.1g}, y shows s = {unseen:.6g} by '
        f'{sight:.1g} ({found.assumption.value}: {found.detail})',
    )


def _least_margin(a: FloatArray, b: FloatArray) -> tuple[float, complex]:
    """Least singular value of ``[A - s I, B]`` relative to the largest, and its unstable mode s.

    In balanced units of the states, with columns of B as large as A.
    """
    balanced, (scale, _) = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    inputs = b / scale[:, None]
    size = float(np.linalg.norm(balanced, 2))
    inputs = inputs * size / np.maximum(np.linalg.norm(inputs, axis=0), 1e-300)
    modes = np.linalg.eigvals(balanced)
    margins = [
        (float(values[-1] / values[0]), complex(mode))
        for mode in modes[modes.real > -_ROUNDING * size]
        for values in [
            np.linalg.svd(np.hstack([balanced - mode * np.eye(len(a)), inputs]), compute_uv=False)
        ]
    ]
    return min(margins, key=lambda margin: margin[0], default=(1.0, 0j))


def _fast_enough(
    model: PlantModel, trials: Iterable[HinfSynthesis], decay: float
) -> tuple[LinearController, float]:
    """First trial whose closed loop decays fast enough, or the one that decays fastest.

    A tight bandwidth limit makes slow closed-loop modes; more process noise removes them.
    """
    fallback: tuple[float, LinearController, float] | None = None
    for trial in trials:
        controller = as_controller(trial)
        abscissa = state_response(model, controller).abscissa
        if fallback is None or abscissa < fallback[0]:
            fallback = (abscissa, controller, trial.gamma)
        if abscissa <= -decay:
            break
    assert fallback is not None
    return fallback[1:]


def _slowest(feasible: Callable[[float], bool], low: float, high: float) -> float:
    if feasible(low):
        return low
    while high > low * (1 + _BANDWIDTH_RTOL):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if feasible(middle) else (middle, high)
    return high
