"""Test scenes: what a camera could look at, as a function of time."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_event_camera.streams.image_source import decode_picture

FloatImage = NDArray[np.float64]

_PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')
_VIDEOS = ('.mp4', '.avi', '.mkv', '.mov', '.webm', '.mpg', '.mpeg')


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


def recorded_frames(path: Path) -> Iterator[NDArray[Any]]:
    """Grey frames of a video file or of a folder of pictures in the order of their names.

    Parameters
    ----------
    path
        File or folder.

    Raises
    ------
    ParameterError
        If there is nothing to show, or the decoder for it is not installed.
    """
    if path.is_dir():
        pictures = sorted(p for p in path.iterdir() if p.suffix.lower() in _PICTURES)
        if not pictures:
            raise ParameterError('source', path, f'has no pictures ({", ".join(_PICTURES)})')
        return (decode_picture(picture.read_bytes()) for picture in pictures)
    if path.is_file() and path.suffix.lower() in _PICTURES:
        return iter([decode_picture(path.read_bytes())])
    if path.is_file() and path.suffix.lower() in _VIDEOS:
        return _video_frames(path)
    raise ParameterError(
        'source', path, f'must be one of {", ".join(SCENES)}, a video file or a folder of pictures'
    )


def _video_frames(path: Path) -> Iterator[NDArray[Any]]:
    try:
        cv2 = importlib.import_module('cv2')
    except ImportError:
        raise ParameterError('source', path, 'needs OpenCV (python3-opencv) for videos') from None
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise ParameterError('source', path, 'can not be opened as a video')
    return _read_video(cv2, video)


def _read_video(cv2: Any, video: Any) -> Iterator[NDArray[Any]]:
    try:
        while True:
            found, frame = video.read()
            if not found:
                return
            yield np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
    finally:
        video.release()
