"""Node `pendulum_sim`: an inverted pendulum whose tip moves over a brightness profile."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.node.spin import run_nodes
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, Kind, ParameterSpec
from dvs_plant_sim.pendulum import Pendulum, PendulumConstants
from dvs_plant_sim.plant_node import PlantNode

# Coefficients in a file are printed to some digits.
_LINEARISATION_RTOL = 1e-6


class PendulumSimNode(PlantNode):
    """The non-linear pendulum; `state_matrix` and `input_matrix` must be its linearisation."""

    own_parameters = (
        ParameterSpec(
            name='plant.mass',
            kind=Kind.FLOAT,
            default=0.2,
            unit='kg',
            interval=POSITIVE,
            description='Mass at the tip of the pendulum',
        ),
        ParameterSpec(
            name='plant.length',
            kind=Kind.FLOAT,
            default=1.0,
            unit='m',
            interval=POSITIVE,
            description='Length of the pendulum',
        ),
        ParameterSpec(
            name='plant.friction',
            kind=Kind.FLOAT,
            default=0.02,
            unit='N m s/rad',
            interval=NON_NEGATIVE,
            description='Viscous friction in the pivot',
        ),
        ParameterSpec(
            name='plant.gravity',
            kind=Kind.FLOAT,
            default=9.81,
            unit='m/s^2',
            interval=POSITIVE,
            description='Acceleration of free fall',
        ),
    )

    def make_plant(self, scenario: Scenario) -> Pendulum:
        """Pendulum of the parameters; see `PlantNode.make_plant`."""
        names = ('mass', 'length', 'friction', 'gravity')
        values: dict[str, Any] = {name: scenario.plant_extras[f'plant.{name}'] for name in names}
        constants = PendulumConstants(**values)
        for name in ('state_matrix', 'input_matrix'):
            _require_linearisation(name, getattr(scenario.model, name), getattr(constants, name))
        return Pendulum(constants, initial_state=scenario.initial_state)

    def luminosity(self, state: FloatArray) -> FloatArray:
        """Brightness profile at the tip, which moves sideways by ``sin(angle)`` lengths.

        Parameters
        ----------
        state
            Angle, rad, and angular velocity, rad/s.
        """
        return super().luminosity(np.array([np.sin(state[0]), state[1]]))


def _require_linearisation(name: str, given: FloatArray, wanted: FloatArray) -> None:
    scale = _LINEARISATION_RTOL * np.abs(wanted).max()
    if given.shape != wanted.shape or np.abs(given - wanted).max() > scale:
        raise ParameterError(
            name,
            given.ravel().tolist(),
            'is not the linearisation of this pendulum at the top, '
            f'[{", ".join(f"{value:.9g}" for value in wanted.ravel())}]',
        )


def main() -> int:
    """Run the node until a signal or the end of its run."""
    return run_nodes([PendulumSimNode])
