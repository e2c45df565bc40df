"""The appendix as an animation: the camera over its brightness profile, its events flashing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from dvs_common.arrays import FloatArray
from dvs_common.drawing import Figure, FigureCanvasAgg, Rectangle, colormaps, to_rgb
from dvs_common.writing import whole_file
from dvs_simulation import plotting
from dvs_simulation.paper.experiments import Experiment
from dvs_simulation.paper.published import TOLERANCE

FRAMES_PER_SECOND = 15
# The approach takes a tenth of a second, the limit cycle goes on for ever: half the frames each.
_APPROACH_S, _END_S = 0.12, 1.2
_FRAMES = 100
# Events of the last frames glow on, so that one sees them.
_GLOW_FRAMES = 2.5
_GREYS = 96


def animate_platform(experiment: Experiment, path: Path, *, frames: int = _FRAMES) -> None:
    """Write the animation as a GIF, in slow motion.

    Parameters
    ----------
    experiment
        Run of the platform.
    path
        File to write.
    frames
        Number of frames, even.
    """
    with plotting.in_style():
        scene = _Scene(experiment, frame_times(frames))
        images = [scene.image(k) for k in range(frames)]
    with whole_file(path) as draft:
        images[0].save(
            draft,
            save_all=True,
            append_images=images[1:],
            duration=round(1000 / FRAMES_PER_SECOND),
            loop=0,
        )


def frame_times(frames: int) -> FloatArray:
    """Ends of the frames, s: the approach in slower motion than what follows.

    Parameters
    ----------
    frames
        Number of frames.
    """
    half = frames // 2
    approach = np.linspace(0, _APPROACH_S, half, endpoint=False)
    return np.concatenate([approach, np.linspace(_APPROACH_S, _END_S, frames - half)])


def event_glow(experiment: Experiment, times: FloatArray) -> FloatArray:
    """Polarity-signed brightness of the flashes, shape (frames, r), within [-1, 1].

    Parameters
    ----------
    experiment
        Run of the platform.
    times
        Ends of the frames, s.
    """
    run, pixels = experiment.run, experiment.loop.pixel_count
    glow = np.zeros((len(times), pixels))
    fade = np.exp(-1 / _GLOW_FRAMES)
    frame = np.searchsorted(times, run.event_time)
    for k in range(len(times)):
        if k:
            glow[k] = fade * glow[k - 1]
        mine = frame == k
        glow[k, run.event_pixel[mine]] = run.event_polarity[mine]
    return glow


def _palette() -> Image.Image:
    """One palette for all frames, so that no colour flickers: greys, flashes, lines on greys."""
    greys = np.linspace(0, 1, _GREYS)[:, None] * np.ones(3)
    flashes = colormaps['RdBu_r'](np.linspace(0, 1, 64))[:, :3]
    lines = [to_rgb(c) for c in (plotting.SKY, plotting.VERMILION, plotting.GREEN)]
    backgrounds = (0.35, 0.5, 0.65, 0.8, 0.95, 1.0)
    blends = [
        share * np.array(line) + (1 - share) * level
        for line in lines
        for share in (1.0, 0.75, 0.5, 0.25)
        for level in backgrounds
    ]
    colours = np.vstack([greys, flashes, blends])
    flat = np.rint(255 * colours).astype(np.uint8).ravel().tolist()
    image = Image.new('P', (1, 1))
    image.putpalette(flat + [0] * (768 - len(flat)))
    return image


_PALETTE = _palette()
_WHITE = _GREYS - 1  # index of the last grey


class _Scene:
    """Everything that stands still is drawn once; a frame adds what moves."""

    def __init__(self, experiment: Experiment, times: FloatArray) -> None:
        self.experiment = experiment
        self.times = times
        self.glow = event_glow(experiment, times)
        self.index = np.searchsorted(experiment.run.sample_time, times)
        self.figure = Figure(figsize=(9.0, 5.0), layout='constrained')
        axes: dict[str, Any] = self.figure.subplot_mosaic(
            [['profile', 'camera'], ['profile', 'error']], width_ratios=(1.35, 1)
        )
        self.canvas = FigureCanvasAgg(self.figure)
        self._draw_profile(axes['profile'])
        self._draw_camera(axes['camera'])
        self._draw_error(axes['error'])
        self.title = axes['profile'].text(
            0.03, 0.95, '', transform=axes['profile'].transAxes, va='top', weight='bold'
        )
        self.moving = [self.path, self.camera, self.flash, self.error, self.title]
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def _draw_profile(self, axes: Any) -> None:
        loop, states = self.experiment.loop, self.experiment.run.states
        c = loop.model.gradient
        low, high = np.array([-0.36, 0.0]), np.array([0.10, 0.40])
        grid = np.meshgrid(np.linspace(low[0], high[0], 60), np.linspace(low[1], high[1], 60))
        brightness = c[0] * grid[0] + c[1] * grid[1] + loop.scene.brightness_offsets.mean()
        axes.imshow(
            brightness,
            extent=(low[0], high[0], low[1], high[1]),
            origin='lower',
            cmap='gray',
            aspect='equal',
            vmin=brightness.min() - 0.25,
            vmax=brightness.max(),
        )
        axes.grid(visible=False)
        (self.path,) = axes.plot([], [], color=plotting.SKY, lw=1.4)
        axes.plot(*loop.equilibrium.state[:2], 'o', color=plotting.VERMILION, ms=7)
        angle = np.linspace(0, 2 * np.pi, 100)
        ball = loop.equilibrium.state[:, None] + TOLERANCE * np.array(
            [np.cos(angle), np.sin(angle)]
        )
        axes.plot(*ball, '--', color=plotting.VERMILION, lw=1.1)
        self.camera = Rectangle((0, 0), 0.032, 0.024, fill=False, ec=plotting.GREEN, lw=2.2)
        axes.add_patch(self.camera)
        axes.set(
            xlabel=r'$x_1$ [unit of x]',
            ylabel=r'$x_2$ [unit of x]',
            title='Platform over the profile',
        )
        self.states = states

    def _draw_camera(self, axes: Any) -> None:
        scene = self.experiment.loop.scene
        self.shape = (scene.height, scene.width)
        self.flash = axes.pcolormesh(
            np.arange(scene.width + 1) - 0.5,
            np.arange(scene.height + 1) - 0.5,
            np.zeros(self.shape),
            cmap='RdBu_r',
            vmin=-1.1,
            vmax=1.1,
            edgecolors='white',
            linewidth=1,
        )
        axes.invert_yaxis()
        axes.set_aspect('equal')
        axes.grid(visible=False)
        axes.tick_params(length=0)
        axes.set(xlabel='pixel column', ylabel='pixel row', title='Events: red ON, blue OFF')

    def _draw_error(self, axes: Any) -> None:
        (self.error,) = axes.plot([], [], color=plotting.GREEN)
        plotting.draw_tolerance(axes, TOLERANCE)
        axes.set(
            xlim=(0, _END_S),
            ylim=(0, 0.38),
            xlabel='time t [s]',
            ylabel=r'$\|x - x_d\|$ [unit of x]',
            title='Error',
        )
        axes.legend(loc='upper right')

    def image(self, frame: int) -> Image.Image:
        """One frame."""
        k = self.index[frame]
        run = self.experiment.run
        self.path.set_data(*self.states[: k + 1].T[:2])
        x, y = self.states[k, :2]
        self.camera.set_xy((x - 0.016, y - 0.012))
        self.flash.set_array(self.glow[frame].reshape(self.shape))
        self.error.set_data(run.sample_time[: k + 1], self.experiment.error[: k + 1])
        events = int(np.searchsorted(run.event_time, self.times[frame], side='right'))
        self.title.set_text(f't = {self.times[frame]:.3f} s\n{events} events')
        self.canvas.restore_region(self.background)
        for artist in self.moving:
            artist.axes.draw_artist(artist)
        pixels = np.asarray(self.canvas.buffer_rgba())[:, :, :3].copy()
        indexed = Image.fromarray(pixels).quantize(palette=_PALETTE, dither=Image.Dither.NONE)
        # The quantiser rounds colours: keep the paper white.
        white = Image.fromarray(np.where(pixels.min(axis=2) == 255, 255, 0).astype(np.uint8))
        indexed.paste(_WHITE, mask=white)
        return indexed
