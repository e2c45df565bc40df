"""A cart-pole in MuJoCo with a camera on its tip: the simulator, its optics, its linearisation.

State x: position of the cart, m, angle of the pole from the upright, rad, and their rates. The
camera at the tip looks along the pole at a ceiling whose brightness grows along the rail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_nanoseconds, as_seconds

MODEL = Path(__file__).with_name('cart_pole.xml')
# Height of the ceiling over the pivot, m; brightness over the origin, and its slope, 1/m.
CEILING, BRIGHTNESS, SLOPE = 3.0, 0.6, 1.0
# Directions of the pixels within the camera, rad.
PIXELS = np.array([-0.005, 0.0, 0.005])


class CartPole:
    """The plant in the form that the suite takes: a state, and a way to advance it."""

    def __init__(self, initial_state: FloatArray) -> None:
        self._model = mujoco.MjModel.from_xml_path(str(MODEL))
        self._data = mujoco.MjData(self._model)
        self._step_ns = as_nanoseconds(self._model.opt.timestep)
        self.state = np.array(initial_state, dtype=float)

    @property
    def state(self) -> FloatArray:
        """Positions and rates, shape (4,)."""
        return np.concatenate([self._data.qpos, self._data.qvel])

    @state.setter
    def state(self, state: FloatArray) -> None:
        self._data.qpos[:], self._data.qvel[:] = np.split(state, 2)

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on in MuJoCo's steps; the last one takes what is left."""
        self._data.ctrl[:] = command
        steps, rest_ns = divmod(duration_ns, self._step_ns)
        mujoco.mj_step(self._model, self._data, nstep=steps)
        if rest_ns:
            self._model.opt.timestep = as_seconds(rest_ns)
            mujoco.mj_step(self._model, self._data)
            self._model.opt.timestep = as_seconds(self._step_ns)

    def rates(self, state: FloatArray, command: FloatArray) -> FloatArray:
        """xdot of a state and a force."""
        self.state, self._data.ctrl[:] = state, command
        mujoco.mj_forward(self._model, self._data)
        return np.concatenate([self._data.qvel, self._data.qacc])


def luminosity(state: FloatArray) -> FloatArray:
    """Brightness of the ceiling where each pixel looks, shape (r,)."""
    position, angle = state[:2]
    tip = position + np.sin(angle)
    above = CEILING - np.cos(angle)
    return np.asarray(BRIGHTNESS + SLOPE * (tip + above * np.tan(angle + PIXELS)))


def linearisation(step: float = 1e-6) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A, B, c and the pixels' displacements at the upright rest, by central differences."""
    plant = CartPole(np.zeros(4))

    def gradient(function: Callable[[FloatArray], FloatArray], size: int) -> FloatArray:
        steps = step * np.eye(size)
        return np.column_stack([(function(d) - function(-d)) / (2 * step) for d in steps])

    dynamics = gradient(lambda z: plant.rates(z[:4], z[4:]), 5)
    optics = gradient(luminosity, 4)
    offsets = np.zeros((PIXELS.size, 4))
    # All of the displacement in the first state, along which c is SLOPE.
    offsets[:, 0] = luminosity(np.zeros(4)) / SLOPE
    return dynamics[:, :4], dynamics[:, 4:], optics[PIXELS.size // 2], offsets


def scenario_values() -> dict[str, Sequence[Any]]:
    """Parameters that the model decides, by name, as `Scenario` and a parameter file have them."""
    a, b, c, offsets = linearisation()
    arrays = {
        'state_matrix': a,
        'input_matrix': b,
        'output_vector': c,
        'pixel_offsets': offsets,
    }
    lists = {name: (array.ravel().round(8) + 0.0).tolist() for name, array in arrays.items()}
    return {**lists, 'pixel_grid': [1, PIXELS.size]}


if __name__ == '__main__':
    for name, value in scenario_values().items():
        print(f'    {name}: {value}')
