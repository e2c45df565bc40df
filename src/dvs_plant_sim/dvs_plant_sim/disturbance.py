"""Seeded noise on the inputs and the state of any plant, and a constant load."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.scenario import Scenario
from dvs_plant_sim.dynamics import Dynamics


def disturbed(plant: Dynamics, scenario: Scenario) -> Dynamics:
    """Plant with noise and load of a scenario; the plant itself if there is none.

    Parameters
    ----------
    plant
        Plant to disturb.
    scenario
        Checked parameters.
    """
    load = scenario.constant_load
    noise = scenario.disturbance.input_disturbance, scenario.disturbance.state_disturbance
    if not any(noise) and not np.any(load):
        return plant
    return DisturbedPlant(
        plant,
        input_disturbance=scenario.disturbance.input_disturbance,
        state_disturbance=scenario.disturbance.state_disturbance,
        load=load,
        seed=scenario.loop.seed,
    )


class DisturbedPlant:
    """A plant with noise and a constant load added; without them it is that plant to the bit.

    Parameters
    ----------
    plant
        Plant to disturb.
    input_disturbance
        Standard deviation of the noise on every input, held for a step.
    state_disturbance
        Intensity of a random walk added to every state, state/sqrt(s).
    load
        Constant added to every input, shape (m,).
    seed
        Seed of the noise.
    """

    def __init__(
        self,
        plant: Dynamics,
        *,
        input_disturbance: float,
        state_disturbance: float,
        load: FloatArray | float = 0.0,
        seed: int,
    ) -> None:
        self._plant = plant
        self._input_disturbance = input_disturbance
        self._state_disturbance = state_disturbance
        self._load = load
        self._generator = np.random.default_rng(seed)

    @property
    def state(self) -> FloatArray:
        """State x of the plant, shape (n,)."""
        return self._plant.state

    @state.setter
    def state(self, state: FloatArray) -> None:
        self._plant.state = state

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on by `duration_ns` with the input held at `command` and noise.

        Parameters
        ----------
        duration_ns
            Length of the step, ns, >= 0.
        command
            u_o, shape (m,).
        """
        if duration_ns == 0:
            return
        command = command + self._load
        if self._input_disturbance:
            noise = self._generator.standard_normal(command.size)
            command = command + self._input_disturbance * noise
        self._plant.advance(duration_ns, command)
        if self._state_disturbance:
            spread = self._state_disturbance * np.sqrt(as_seconds(duration_ns))
            noise = self._generator.standard_normal(self._plant.state.size)
            self._plant.state = self._plant.state + spread * noise
