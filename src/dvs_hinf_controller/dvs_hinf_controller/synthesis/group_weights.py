"""H-infinity designs for several pixel groups, and the search for their weights."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.plant_rates import control_rate, plant_rate
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.hinf_synthesis import hinf_synthesis
from dvs_hinf_controller.synthesis.one_pixel_plant import reduced_plant
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import as_controller, synthesize_unstructured

# Factors by which weights are moved, from coarse to fine, and weights that are tried at most.
_FACTORS = (8.0, 2.0)
_MOST_TRIALS = 24
_BANDWIDTH = 1e-2
_NOISE = 0.1
_SLACK = 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupWeights:
    """Free weights of an H-infinity design.

    Parameters
    ----------
    logs
        Natural logarithms of the bandwidth and of the process noise, relative to the plant's own
        rate, and of the size of the mean disturbance of every group, shape (2 + k,).
    """

    logs: FloatArray

    @classmethod
    def first(cls, disturbances: FloatArray) -> GroupWeights:
        """Weights from which a search starts.

        Parameters
        ----------
        disturbances
            Size of the mean disturbance of every group, shape (k,).
        """
        return cls(logs=np.log([_BANDWIDTH, _NOISE, *disturbances]))

    def moved(self, index: int, factor: float) -> GroupWeights:
        """The same with one weight multiplied.

        Parameters
        ----------
        index
            Which.
        factor
            By what.
        """
        logs = self.logs.copy()
        logs[index] += math.log(factor)
        return GroupWeights(logs=logs)


def with_scales(
    model: PlantModel, scales: FloatArray, synthesize: Callable[[PlantModel], LinearController]
) -> LinearController:
    """Controller for mean disturbances of unequal sizes: each measured in its own unit.

    Parameters
    ----------
    model
        Plant.
    scales
        Size of the mean disturbance of every group, shape (k,).
    synthesize
        Design for disturbances of equal size.
    """
    found = synthesize(replace(model, output_vector=model.gradients / scales[:, None]))
    return replace(
        found, input_vector=found.input_vector / scales, feedthrough=found.feedthrough / scales
    )


def synthesize_groups(
    problem: DesignProblem, options: DesignOptions, model: PlantModel
) -> LinearController:
    """Controller of (nearly) the least norm of the paper's plant with all its pixels.

    Parameters
    ----------
    problem
        Pixels of every group.
    options
        Slack, limit of the bandwidth, process noise.
    model
        Plant.

    Raises
    ------
    SynthesisError
        If the plant is not stabilizable or not detectable, or double precision does not suffice.
    """
    if model.group_count == 1:
        return synthesize_unstructured(model, options)
    return with_scales(
        model, problem.group_scales, lambda scaled: synthesize_unstructured(scaled, options)
    )


def weighted_controller(
    plant: PlantModel, weights: GroupWeights, *, limit: float
) -> LinearController:
    """Central H-infinity controller for weights.

    Parameters
    ----------
    plant
        In units in which its numbers are near one.
    weights
        Weights.
    limit
        Largest bandwidth, rad/s; infinite for none.

    Raises
    ------
    SynthesisError
        If there is none.
    """
    bandwidth, noise, *scales = np.exp(weights.logs).tolist()
    gain = max(float(np.linalg.norm(plant.input_matrix, 2)), 1e-300)

    def of(model: PlantModel) -> LinearController:
        generalized = reduced_plant(
            model,
            input_cost=gain / min(bandwidth * plant_rate(model), limit),
            process_noise=noise * control_rate(model) / float(np.linalg.norm(model.gradients)),
        )
        return as_controller(hinf_synthesis(generalized, slack=_SLACK, rtol=1e-3))

    return with_scales(plant, np.array(scales), of)


def best_weights(score: Callable[[GroupWeights], float], first: GroupWeights) -> None:
    """Move one weight after the other while the score grows, by ever smaller factors.

    Parameters
    ----------
    score
        Judges weights, and keeps what it needs of the best.
    first
        Where to start; the first disturbance keeps its size, as only ratios count.
    """
    best, level, trials = first, score(first), 1
    free = [index for index in range(first.logs.size) if index != 2]
    for factor in _FACTORS:
        moved = True
        while moved and trials < _MOST_TRIALS:
            moved = False
            for index in free:
                for change in (factor, 1 / factor):
                    trial = best.moved(index, change)
                    found, trials = score(trial), trials + 1
                    if found > level:
                        best, level, moved = trial, found, True
                        break
