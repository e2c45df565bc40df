"""What a constant disturbance leaves of the loop in the limit."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.sampled_gains import Gains
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.state_space import state_response


class StaticGains:
    """Equilibria of a stable loop under constant disturbances; sampled and continuous alike.

    Parameters
    ----------
    model
        Plant.
    controller
        K.
    weights
        W of the error, shape (n,); None for all 1.
    """

    def __init__(
        self, model: PlantModel, controller: LinearController, weights: FloatArray | None
    ) -> None:
        self._model, self._controller = model, controller
        self._weights = np.ones(model.state_count) if weights is None else weights
        self._loop = state_response(model, controller)

    def of_load(self, column: FloatArray, size: float) -> Gains:
        """Where a constant load moves the loop.

        Parameters
        ----------
        column
            Column of B, shape (n,).
        size
            Load, in the unit of the input.
        """
        return self.of_drive(column * size)

    def of_drive(self, drive: FloatArray) -> Gains:
        """Where a constant addition to xdot moves the loop.

        Parameters
        ----------
        drive
            Shape (n,).
        """
        return self._moved(np.concatenate([drive, np.zeros(self._controller.order)]), 0.0)

    def of_measurement(self) -> Gains:
        """Where a constant error of 1 of all measured deviations moves the loop."""
        return self._moved(self._loop.b.sum(axis=1), 1.0)

    def _moved(self, drive: FloatArray, error: float) -> Gains:
        state = np.linalg.solve(self._loop.a, -drive)
        n, k = self._model.state_count, self._controller
        x, output = state[:n], np.atleast_1d(self._model.output_vector @ state[:n])
        command = k.output_matrix @ state[n:] + k.feedthrough_matrix @ (output + error)
        return Gains(
            error=float(np.linalg.norm(self._weights * x)),
            states=np.abs(x),
            output=np.abs(output),
            output_rate=np.zeros(output.size),
            output_curve=np.zeros(output.size),
            commands=np.abs(command),
            changes=np.zeros(self._model.input_count),
        )
