"""The second way to a luminosity: frames that MuJoCo renders, without a display.

It needs EGL or OSMesa. MUJOCO_GL names one of them, and is read where mujoco is first imported.
"""

from __future__ import annotations

import os

os.environ.setdefault('MUJOCO_GL', 'egl')

import cart_pole
import mujoco
import numpy as np

from dvs_common.arrays import FloatArray

WIDTH, HEIGHT = 256, 16
# Half the angle that a pixel sees, rad.
APERTURE = 0.05
# Brightness of a grey level: the ceiling is white where it is 2.
GREY = 2 / 255


class RenderedOptics:
    """What the pixels see in a frame of the camera on the tip: the mean of their columns."""

    def __init__(self) -> None:
        self._model = mujoco.MjModel.from_xml_path(str(cart_pole.MODEL))
        self._data = mujoco.MjData(self._model)
        # A slope without steps between the grey levels, which no builtin texture is.
        self._model.tex_data[:] = np.repeat(np.arange(256, dtype=np.uint8), 3)
        self._renderer = mujoco.Renderer(self._model, HEIGHT, WIDTH)
        focus = HEIGHT / 2 / np.tan(np.radians(self._model.camera('eye').fovy[0]) / 2)
        columns = np.arctan((np.arange(WIDTH) - (WIDTH - 1) / 2) / focus)
        self._seen = np.abs(columns - cart_pole.PIXELS[:, None]) < APERTURE

    def luminosity(self, state: FloatArray) -> FloatArray:
        """Brightness of each pixel, shape (r,)."""
        self._data.qpos[:] = state[:2]
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, camera='eye')
        columns = GREY * self._renderer.render()[..., 0].mean(axis=0)
        return np.array([columns[seen].mean() for seen in self._seen])
