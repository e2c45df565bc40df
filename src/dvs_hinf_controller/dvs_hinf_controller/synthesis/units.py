"""Units in which a plant's numbers are near one, so that no method depends on the user's units."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.plant_rates import plant_rate
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.options import DesignOptions

# Weight of a free state beside the least of the others: the units need one.
_FREE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Units:
    """``t = t' / rate``, ``y = luminosity y'``, ``u_j = inputs_j u_j'``, ``x_i = states_i x_i'``.

    Parameters
    ----------
    rate
        rad/s.
    luminosity
        Unit of y.
    inputs
        Unit of every input, shape (m,).
    states
        Unit of every state, shape (n,).
    """

    rate: float
    luminosity: float
    inputs: FloatArray
    states: FloatArray

    @classmethod
    def of(cls, model: PlantModel) -> Units:
        """Units in which rate, c and every column of B lie within a factor of 32 of one.

        Powers of 1024, so that an ordinary plant keeps its units, and its controller each digit.

        Parameters
        ----------
        model
            Plant.
        """
        luminosity = float(np.linalg.norm(model.output_vector))
        return cls._with_states(model, np.ones(model.state_count), _prefix(luminosity))

    @classmethod
    def of_problem(cls, problem: DesignProblem) -> Units:
        """Units in which, besides, the tolerance of each state is 1 and so is the mean luminosity.

        Parameters
        ----------
        problem
            Plant, tolerance and luminosities.
        """
        luminosity = problem.mean_luminosity
        if luminosity == 0:
            luminosity = problem.tolerance * float(np.linalg.norm(problem.model.output_vector))
        weights = problem.error_weights
        if weights is None:
            weights = np.ones(problem.model.state_count)
        free = _FREE * weights[weights > 0].min()
        states = problem.tolerance / np.where(weights > 0, weights, free)
        return cls._with_states(problem.model, states, luminosity)

    @classmethod
    def _with_states(cls, model: PlantModel, states: FloatArray, luminosity: float) -> Units:
        columns = np.linalg.norm(model.input_matrix / states[:, None], axis=0)
        rate = _prefix(plant_rate(model))
        return cls(
            rate=rate,
            luminosity=luminosity,
            inputs=rate / np.array([_prefix(column) if column > 0 else 1.0 for column in columns]),
            states=states,
        )

    def plant(self, model: PlantModel) -> PlantModel:
        """The plant in these units.

        Parameters
        ----------
        model
            Plant in the user's units.
        """
        return PlantModel(
            state_matrix=model.state_matrix / self.states[:, None] * self.states / self.rate,
            input_matrix=model.input_matrix / self.states[:, None] * self.inputs / self.rate,
            output_vector=model.output_vector * self.states / self.luminosity,
        )

    def options(self, options: DesignOptions) -> DesignOptions:
        """Options with the bandwidth limit in these units.

        Parameters
        ----------
        options
            In the user's units.
        """
        return replace(options, bandwidth_limit=options.bandwidth_limit / self.rate)

    def controller(self, k: LinearController) -> LinearController:
        """The controller in the user's units, from these.

        Parameters
        ----------
        k
            Controller of the plant in these units.
        """
        return LinearController(
            state_matrix=k.state_matrix * self.rate,
            input_vector=k.input_vector * self.rate / self.luminosity,
            output_matrix=k.output_matrix * self.inputs[:, None],
            feedthrough=(k.feedthrough.T * self.inputs).T / self.luminosity,
        )


def _prefix(value: float) -> float:
    """Nearest power of 1024, as unit prefixes go."""
    return float(1024.0 ** round(math.log(value, 1024)))
