"""The picture of a run: error, phase portrait, events, and the estimate over the luminosity."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dvs_closed_loop.trace import Trace
from dvs_closed_loop.verdict import Verdict
from dvs_interfaces.scenario import Scenario

# Okabe and Ito's palette: told apart by every kind of colour vision.
BLUE, VERMILION, GREEN, GREY = '#0072B2', '#D55E00', '#009E73', '#7f7f7f'
_MOST_RASTER_EVENTS = 200_000


def save_figure(trace: Trace, scenario: Scenario, verdict: Verdict, path: Path) -> None:
    """Draw a run into an image file.

    Parameters
    ----------
    trace
        Signals of the run.
    scenario
        Its parameters.
    verdict
        Its figures.
    path
        File to write; the ending decides the format.
    """
    matplotlib.use('Agg', force=False)
    figure = Figure(figsize=(12, 8), layout='constrained')
    axes = figure.subplots(2, 2)
    _draw_error(axes[0, 0], trace, scenario)
    _draw_phase_portrait(axes[0, 1], trace, scenario)
    _draw_events(axes[1, 0], trace)
    _draw_estimate(axes[1, 1], trace)
    word = 'regulated' if verdict.regulated else 'not regulated'
    figure.suptitle(
        f'{verdict.scenario}: {word}, r = {verdict.pixels}, h = {verdict.h:g} '
        f'(h* = {verdict.h_star:.4f}), {verdict.events} events'
    )
    figure.savefig(path, dpi=110)


def _draw_error(axes: Axes, trace: Trace, scenario: Scenario) -> None:
    errors = np.linalg.norm(trace.states - np.array(scenario['set_point']), axis=1)
    axes.semilogy(trace.times_s, errors, color=BLUE, lw=1.2)
    axes.axhline(scenario['tolerance'], color=VERMILION, ls='--', lw=1, label='tolerance eps')
    axes.set(xlabel='time [s]', ylabel='error ||x - x_d|| [state units]', title='Error')
    axes.legend(loc='upper right', frameon=False)
    axes.grid(alpha=0.3, which='both')


def _draw_phase_portrait(axes: Axes, trace: Trace, scenario: Scenario) -> None:
    centre = np.array(scenario['set_point'])
    if centre.size < 2:
        axes.plot(trace.times_s, trace.states[:, 0], color=BLUE, lw=1.2)
        axes.set(xlabel='time [s]', ylabel='x1 [state units]', title='State')
        return
    axes.plot(trace.states[:, 0], trace.states[:, 1], color=BLUE, lw=0.9)
    axes.plot(*trace.states[0, :2], 'o', color=GREEN, ms=6, label='start x0')
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = scenario['tolerance'] * np.array([np.cos(angle), np.sin(angle)])
    axes.plot(
        centre[0] + circle[0], centre[1] + circle[1], '--', color=VERMILION, lw=1, label='eps ball'
    )
    axes.plot(*centre[:2], '+', color=VERMILION, ms=9, label='set-point x_d')
    axes.set(xlabel='x1 [state units]', ylabel='x2 [state units]', title='Phase portrait')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(loc='best', frameon=False)
    axes.grid(alpha=0.3)


def _draw_events(axes: Axes, trace: Trace) -> None:
    stride = max(1, len(trace.events) // _MOST_RASTER_EVENTS)
    times, pixels = trace.event_times_s[::stride], trace.event_pixels[::stride]
    polarity = trace.events['polarity'][::stride]
    for value, colour, name in ((1, VERMILION, 'ON (+1)'), (-1, BLUE, 'OFF (-1)')):
        chosen = polarity == value
        axes.scatter(times[chosen], pixels[chosen], s=14, marker='|', color=colour, label=name)
    axes.set(xlabel='time [s]', ylabel='pixel [row-major number]', title='Events')
    axes.set_xlim(trace.times_s[0], trace.times_s[-1])
    pixel_count = trace.luminosities.shape[1]
    axes.set_ylim(-0.6, pixel_count - 0.4)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc='upper right', frameon=True, framealpha=0.8)


def _draw_estimate(axes: Axes, trace: Trace) -> None:
    axes.plot(trace.times_s, trace.luminosities[:, 0], color=GREY, lw=1.4, label='luminosity y')
    axes.step(
        trace.times_s, trace.estimates[:, 0], where='post', color=BLUE, lw=0.9, label='estimate z'
    )
    axes.set(
        xlabel='time [s]', ylabel='luminosity [luminosity units]', title='Estimate of pixel 0'
    )
    axes.legend(loc='best', frameon=False)
    axes.grid(alpha=0.3)
