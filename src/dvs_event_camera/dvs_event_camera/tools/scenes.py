"""Test scenes: what a camera could look at, as a function of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_event_camera.tools.footage import recorded_frames

__all__ = ['SCENES', 'Scene', 'recorded_frames', 'synthetic_frames']

FloatImage = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A synthetic scene between a dark and a bright luminosity.

    Parameters
    ----------
    height
        Rows.
    width
        Columns.
    speed
        Pixels a second of what moves, pixels/s.
    frequency
        Turns or periods a second of what turns or flickers, Hz.
    period
        Wavelength of the grating, pixels.
    dark
        Smallest luminosity, > 0.
    bright
        Largest luminosity.

    Raises
    ------
    ParameterError
        If a number is out of range.
    """

    height: int = 180
    width: int = 240
    speed: float = 100.0
    frequency: float = 2.0
    period: float = 40.0
    dark: float = 20.0
    bright: float = 200.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.height < 1 or self.width < 1:
            raise ParameterError('size', f'{self.height}x{self.width}', 'must be at least 1x1')
        if not 0 < self.dark <= self.bright < math.inf:
            raise ParameterError('dark', self.dark, f'must be > 0 and <= bright = {self.bright}')
        if not 0 < self.period < math.inf:
            raise ParameterError('period', self.period, 'must be > 0')
        for name in ('speed', 'frequency'):
            if not math.isfinite(getattr(self, name)):
                raise ParameterError(name, getattr(self, name), 'must be finite')

    def grating(self, time_s: float) -> FloatImage:
        """Sinusoidal grating, drifting to the right.

        Parameters
        ----------
        time_s
            Time, s.
        """
        phase = 2 * np.pi * (np.arange(self.width) - self.speed * time_s) / self.period
        row = self._mix(0.5 + 0.5 * np.sin(phase))
        return np.broadcast_to(row, (self.height, self.width)).copy()

    def bar(self, time_s: float) -> FloatImage:
        """Bright bar, an eighth of the width, moving to the right and coming back on the left.

        Parameters
        ----------
        time_s
            Time, s.
        """
        thickness = max(self.width / 8, 1.0)
        behind = (self.speed * time_s - np.arange(self.width)) % (self.width + thickness)
        # Edges one pixel wide, as a lens makes them.
        share = np.clip(np.minimum(behind, thickness - behind) + 0.5, 0.0, 1.0)
        return np.broadcast_to(self._mix(share), (self.height, self.width)).copy()

    def disc(self, time_s: float) -> FloatImage:
        """Disc with four bright and four dark sectors, turning.

        Parameters
        ----------
        time_s
            Time, s.
        """
        y = np.arange(self.height)[:, None] - (self.height - 1) / 2
        x = np.arange(self.width)[None, :] - (self.width - 1) / 2
        radius = np.hypot(x, y)
        angle = np.arctan2(y, x) - 2 * np.pi * self.frequency * time_s
        edge = np.clip(radius * np.sin(4 * angle) / 4 + 0.5, 0.0, 1.0)
        inside = np.clip(0.45 * min(self.height, self.width) - radius + 0.5, 0.0, 1.0)
        return self._mix(inside * edge)

    def step(self, time_s: float) -> FloatImage:
        """All bright in the second half of every period, all dark in the first.

        Parameters
        ----------
        time_s
            Time, s.
        """
        lit = (self.frequency * time_s) % 1.0 >= 0.5
        return np.full((self.height, self.width), self.bright if lit else self.dark)

    def flicker(self, time_s: float) -> FloatImage:
        """All pixels in step, their logarithm a sinusoid.

        Parameters
        ----------
        time_s
            Time, s.
        """
        wave = 0.5 - 0.5 * math.cos(2 * np.pi * self.frequency * time_s)
        level = self.dark * (self.bright / self.dark) ** wave
        return np.full((self.height, self.width), level)

    def _mix(self, share: NDArray[np.float64]) -> FloatImage:
        return np.asarray(self.dark + (self.bright - self.dark) * share)


SCENES: dict[str, Callable[[Scene, float], FloatImage]] = {
    'grating': Scene.grating,
    'bar': Scene.bar,
    'disc': Scene.disc,
    'step': Scene.step,
    'flicker': Scene.flicker,
}


def synthetic_frames(name: str, scene: Scene, period_ns: int) -> Iterator[NDArray[Any]]:
    """Endless frames of a scene, sampled every `period_ns`.

    Parameters
    ----------
    name
        One of `SCENES`.
    scene
        Its measures.
    period_ns
        Sampling period, ns.
    """
    draw = SCENES[name]
    number = 0
    while True:
        yield draw(scene, as_seconds(number * period_ns))
        number += 1
