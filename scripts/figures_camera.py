#!/usr/bin/env python3
"""Draws the figures of docs/event_camera.md into docs/figures."""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from checkout import add_output

from dvs_common.nanoseconds import as_seconds
from dvs_common.output_folder import output_folder
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import SignedLogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.renderer import PALETTES, EventRenderer
from dvs_event_camera.tools.scenes import SCENES, Scene

mpl.use('Agg')
import matplotlib.pyplot as plt

MS = 1_000_000
# Okabe and Ito: told apart by every kind of colour vision.
BLACK, ORANGE, BLUE, GREEN = '#222222', '#D55E00', '#0072B2', '#009E73'


def run(array: PixelArray, stamps: np.ndarray, frames: np.ndarray) -> PixelEvents:
    """All events of a run."""
    events = PixelEvents.empty()
    for stamp, frame in zip(stamps, frames, strict=True):
        events = PixelEvents.merged(events, array.update(int(stamp), frame))
    return events


def staircase(events: PixelEvents, end_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Sum of polarities over time, as the corners of a staircase."""
    t = np.r_[0.0, as_seconds(events.t), end_s]
    total = np.r_[0, np.cumsum(events.polarity)]
    return np.repeat(t, 2)[1:-1], np.repeat(total, 2)


def draw_pixel(folder: Path) -> None:
    """A pixel, its reference and its events."""
    h = 0.25
    stamps = np.arange(0, 1001) * MS
    level = 0.9 * np.sin(2 * np.pi * as_seconds(stamps)) + 0.25 * np.sin(
        6 * np.pi * as_seconds(stamps)
    )
    events = run(PixelArray(event_threshold=h), stamps, np.exp(level)[:, None])
    figure, (top, bottom) = plt.subplots(
        2, 1, sharex=True, figsize=(7.5, 4.2), height_ratios=(4, 1), layout='constrained'
    )
    seconds = as_seconds(stamps)
    t, total = staircase(events, 1.0)
    top.fill_between(t, (total - 1) * h, (total + 1) * h, color=BLUE, alpha=0.15, lw=0)
    top.plot(t, total * h, color=BLUE, label='reference, ln q/q(0) = N h')
    top.plot(seconds, level, color=BLACK, label='luminosity, ln y/y(0)')
    top.fill_between([], [], color=BLUE, alpha=0.15, lw=0, label='no event within one threshold h')
    top.set_ylabel('natural logarithm [1]')
    top.set_yticks(np.arange(-4, 5) * h)
    top.grid(alpha=0.25)
    top.legend(loc='lower left', frameon=False)
    on = events.polarity > 0
    for chosen, colour, side, label in ((on, ORANGE, 1, 'ON'), (~on, BLUE, -1, 'OFF')):
        bottom.vlines(as_seconds(events.t[chosen]), 0, side, color=colour, label=label)
    bottom.axhline(0, color=BLACK, lw=0.8)
    bottom.set_yticks([-1, 1], ['OFF', 'ON'])
    bottom.set_xlabel('time [s]')
    bottom.set_ylabel('events')
    figure.savefig(folder / 'camera_pixel.png', dpi=130)
    plt.close(figure)


def stamp_error(period_ns: int, interpolation: str) -> float:
    """Worst error of a stamp, s, with a luminosity that settles in 50 ms."""
    tau, h = 0.05, 0.1
    stamps = np.arange(0, 250 * MS, period_ns)
    y = 1.0 - 0.8 * np.exp(-as_seconds(stamps) / tau)
    events = run(PixelArray(event_threshold=h, interpolation=interpolation), stamps, y[:, None])
    found = as_seconds(events.t)
    true = -tau * np.log((1 - 0.2 * np.exp(h * np.arange(1, found.size + 1))) / 0.8)
    late = true > 4 * as_seconds(period_ns)
    return float(np.abs(found - true)[late].max())


def draw_stamp_errors(folder: Path) -> None:
    """Error of the stamps against the sampling rate."""
    periods = np.array([20, 10, 5, 2, 1, 0.5, 0.2, 0.1]) * MS
    figure, axes = plt.subplots(figsize=(6.0, 3.8), layout='constrained')
    for kind, colour, marker in (('linear_log', BLUE, 'o'), ('hermite', ORANGE, 's')):
        errors = [stamp_error(int(period), kind) for period in periods]
        axes.loglog(1 / as_seconds(periods), errors, marker=marker, color=colour, label=kind)
    axes.axhline(1e-9, color=BLACK, ls=':', lw=1)
    axes.annotate(
        'one nanosecond: the stamp itself', (1 / as_seconds(periods)[0], 1.2e-9), fontsize=9
    )
    axes.set_xlabel('sampling rate [Hz]')
    axes.set_ylabel('worst error of a stamp [s]')
    axes.grid(alpha=0.3, which='both')
    axes.legend(frameon=False)
    figure.savefig(folder / 'camera_stamp_error.png', dpi=130)
    plt.close(figure)


def draw_signed(folder: Path) -> None:
    """A luminosity that changes sign, with the signed-log pixel."""
    h, band = 0.4, 0.05
    receptor = SignedLogPhotoreceptor(dead_band=band)
    stamps = np.arange(0, 1001, 5) * MS
    y = 0.9 * np.cos(np.pi * as_seconds(stamps))
    array = PixelArray(event_threshold=h, photoreceptor=receptor)
    events = run(array, stamps, y[:, None])
    figure, axes = plt.subplots(figsize=(7.5, 3.8), layout='constrained')
    axes.axhspan(-band, band, color=GREEN, alpha=0.2, lw=0, label='silent band, |y| < d')
    t = np.r_[0.0, as_seconds(events.t), 1.0]
    reference = np.r_[1, events.sign] * 0.9 * np.exp(h * np.r_[0, np.cumsum(events.polarity)])
    axes.step(
        t, np.r_[reference, reference[-1]], where='post', color=BLUE, label='reference s |q|'
    )
    axes.plot(as_seconds(stamps), y, color=BLACK, label='luminosity y')
    flip = as_seconds(events.t[np.flatnonzero(np.diff(events.sign))[0]])
    axes.annotate(
        'OFF (old sign), ON (new sign):\nthe reference changes sides',
        (flip, -band),
        (flip + 0.08, 0.45),
        arrowprops={'arrowstyle': '->'},
    )
    axes.set_xlabel('time [s]')
    axes.set_ylabel('luminosity [unit of y]')
    axes.grid(alpha=0.25)
    axes.legend(loc='lower left', frameon=False)
    figure.savefig(folder / 'camera_signed_log.png', dpi=130)
    plt.close(figure)


def draw_imperfections(folder: Path) -> None:
    """Sum of polarities under one imperfection at a time."""
    h = 0.15
    stamps = np.arange(0, 1001) * MS
    seconds = as_seconds(stamps)
    level = 1.2 * (1 - np.cos(2 * np.pi * seconds)) / 2
    cases = {
        'ideal': Imperfections(),
        'refractory_period = 80 ms': Imperfections(refractory_period=0.08),
        'threshold_mismatch = 0.2': Imperfections(threshold_mismatch=0.2),
        'leak_rate = 5/s': Imperfections(leak_rate=5.0),
        'shot_noise_rate = 20/s': Imperfections(shot_noise_rate=20.0),
        'cutoff_frequency = 2 Hz': Imperfections(cutoff_frequency=2.0),
        'latency = 50 ms': Imperfections(latency=0.05),
        'jitter = 20 ms': Imperfections(jitter=0.02),
    }
    figure, axes = plt.subplots(
        2, 4, sharex=True, sharey=True, figsize=(11, 5), layout='constrained'
    )
    for panel, (name, imperfections) in zip(axes.ravel(), cases.items(), strict=True):
        array = PixelArray(event_threshold=h, imperfections=imperfections, seed=4)
        events = run(array, stamps, np.exp(level)[:, None])
        panel.plot(seconds, level, color=BLACK, label='luminosity, ln y/y(0)')
        t, total = staircase(events, 1.0)
        panel.plot(t, total * h, color=ORANGE, label='sum of polarities times h')
        panel.set_title(name, fontsize=10)
        panel.grid(alpha=0.25)
    for panel in axes[1]:
        panel.set_xlabel('time [s]')
    for panel in axes[:, 0]:
        panel.set_ylabel('natural logarithm [1]')
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=2, frameon=False)
    figure.savefig(folder / 'camera_imperfections.png', dpi=130)
    plt.close(figure)


def rendered(name: str, style: str, palette: str) -> np.ndarray:
    """Picture of a scene's events, red, green, blue."""
    scene = Scene(height=150, width=200, speed=1300.0, frequency=3.0)
    array = PixelArray(event_threshold=0.2)
    renderer = EventRenderer(150, 200, style=style, palette=palette, decay_s=0.03)
    for k in range(101):
        events = array.update(k * MS, SCENES[name](scene, k * 1e-3))
        if style == 'surface' or k > 80:
            renderer.add(events, k * MS)
    return renderer.draw()[..., ::-1]


def draw_renderings(folder: Path) -> None:
    """What event_image shows."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.3), layout='constrained')
    cases = (
        ('disc', 'time_slice', 'red_blue'),
        ('disc', 'surface', 'red_blue'),
        ('bar', 'surface', 'orange_blue'),
    )
    for panel, (scene, style, palette) in zip(axes, cases, strict=True):
        panel.imshow(rendered(scene, style, palette))
        panel.set_title(f'scene {scene}, {style}, {palette}', fontsize=10)
        for row, (name, colour) in enumerate(zip(('ON', 'OFF'), PALETTES[palette], strict=True)):
            blue, green, red = np.array(colour) / 255
            panel.text(5, 14 + 16 * row, name, color=(red, green, blue), weight='bold')
        panel.set_xlabel('x [pixels]')
        panel.set_ylabel('y [pixels]')
    figure.savefig(folder / 'camera_event_image.png', dpi=130)
    plt.close(figure)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output(parser)
    folder = output_folder(parser.parse_args().output)
    for draw in (
        draw_pixel,
        draw_stamp_errors,
        draw_signed,
        draw_imperfections,
        draw_renderings,
    ):
        draw(folder)


if __name__ == '__main__':
    main()
