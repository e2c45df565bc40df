"""The picture of a run: error, states, events, estimate and its error, command."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.drawing import Axes, Figure, LogFormatter, MaxNLocator, drawing
from dvs_common.scenario.scenario import Scenario
from dvs_common.writing import whole_file
from dvs_simulation.judging.measures import error, sector_ratio, silent_below
from dvs_simulation.judging.trace import Trace
from dvs_simulation.judging.verdict import Verdict

# Okabe and Ito's palette: told apart by every kind of colour vision.
BLUE, VERMILION, GREEN, GREY = '#0072B2', '#D55E00', '#009E73', '#7f7f7f'
# To look for the place of a title takes a tenth of the drawing.
_STYLE = {'axes.titley': 1.0}
_MOST_RASTER_EVENTS = 200_000
_MOST_VECTOR_EVENTS = 3_000
_SUPERSCRIPTS = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


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
    with drawing(_STYLE), whole_file(path) as draft:
        _overview(trace, scenario, verdict).savefig(draft, dpi=110)


def _overview(trace: Trace, scenario: Scenario, verdict: Verdict) -> Figure:
    # A layout of our own: to work one out takes as long as to draw the figure.
    figure = Figure(figsize=(12, 12))
    figure.subplots_adjust(
        left=0.075, right=0.985, bottom=0.045, top=0.93, wspace=0.18, hspace=0.26
    )
    axes = figure.subplots(3, 2)
    for panel, draw in zip(axes.flat, PANELS.values(), strict=True):
        draw(panel, trace, scenario, verdict)
    figure.suptitle(
        f'{verdict.scenario}: {verdict.word}, r = {verdict.pixels}, h = {verdict.h:g} '
        f'({verdict.promise}; h_certified = {verdict.certified_text}, '
        f'h* = {verdict.published_text}), {verdict.events} events'
    )
    return figure


def phase_portrait_title(states: int) -> str:
    """Title that names the states which a plane can't show.

    Parameters
    ----------
    states
        n.
    """
    if states <= 2:
        return 'Phase portrait'
    hidden = 'x3' if states == 3 else f'x3 to x{states}'
    return f'Phase portrait (not shown: {hidden})'


def panel_svg(name: str, trace: Trace, scenario: Scenario, verdict: Verdict) -> bytes:
    """One panel as an SVG document.

    Parameters
    ----------
    name
        Key of `PANELS`.
    trace
        Signals of the run.
    scenario
        Its parameters.
    verdict
        Its figures.
    """
    buffer = io.BytesIO()
    # Ids from the panel's name, and no date, so that the same run gives the same bytes.
    with drawing({**_STYLE, 'svg.hashsalt': name}):
        figure = Figure(figsize=(6.4, 4.0))
        figure.subplots_adjust(left=0.14, right=0.97, bottom=0.125, top=0.91)
        PANELS[name](figure.subplots(), trace, scenario, verdict)
        figure.savefig(buffer, format='svg', dpi=150, metadata={'Date': None})
    return buffer.getvalue()


def _head(axes: Axes, title: str, **legend: float) -> None:
    """Title and legend above the axes: a long run fills every place inside."""
    axes.set_title(title, loc='left')
    axes.legend(
        loc='lower right',
        bbox_to_anchor=(1, 1),
        ncols=4,
        frameon=False,
        borderaxespad=0,
        columnspacing=0.8,
        **legend,
    )


def _show_whole_time(axes: Axes, trace: Trace) -> None:
    """The same axis in every panel."""
    if trace.times_s[-1] > trace.times_s[0]:
        axes.set_xlim(trace.times_s[0], trace.times_s[-1])


class PowersOfTen(LogFormatter):
    """Labels such as 10⁻² and 2×10⁻² in plain text: a formula takes as long as a panel."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of a tick, empty for one that has none.

        Parameters
        ----------
        x
            Where it is.
        pos
            Its number.
        """
        if not super().__call__(x, pos):
            return ''
        digits, exponent = f'{x:.5e}'.split('e')
        power = '10' + str(int(exponent)).translate(_SUPERSCRIPTS)
        factor = f'{float(digits):g}'
        return power if factor == '1' else f'{factor}×{power}'


def _draw_error(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    errors = error(trace.states, scenario.equilibrium, scenario.error_weights)
    axes.plot(trace.times_s, errors, color=BLUE, lw=1.2)
    if np.any(errors > 0):
        axes.set_yscale('log')
        axes.yaxis.set_major_formatter(PowersOfTen())
        axes.yaxis.set_minor_formatter(PowersOfTen())
    axes.axhline(
        scenario.objective.tolerance, color=VERMILION, ls='--', lw=1, label='tolerance eps'
    )
    weighted = bool(scenario.objective.error_weights)
    label = (
        'error ||W (x - x_d)|| [units of W x]' if weighted else 'error ||x - x_d|| [state units]'
    )
    axes.set(xlabel='time [s]', ylabel=label)
    _show_whole_time(axes, trace)
    _head(axes, 'Error')
    axes.grid(alpha=0.3, which='both')


def _draw_phase_portrait(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    centre = scenario.equilibrium.state
    if centre.size < 2:
        axes.plot(trace.times_s, trace.states[:, 0], color=BLUE, lw=1.2)
        for bound in centre[0] + scenario.objective.tolerance * np.array([-1, 1]):
            axes.axhline(bound, color=VERMILION, ls='--', lw=1)
        axes.plot([], [], '--', color=VERMILION, lw=1, label='set-point x_d ± eps')
        axes.set(xlabel='time [s]', ylabel='x1 [state units]')
        _show_whole_time(axes, trace)
        _head(axes, 'State')
        axes.grid(alpha=0.3)
        return
    axes.plot(trace.states[:, 0], trace.states[:, 1], color=BLUE, lw=0.9)
    axes.plot(*trace.states[0, :2], 'o', color=GREEN, ms=6, label='start x0')
    _draw_tolerance(axes, centre, scenario)
    axes.plot(*centre[:2], '+', color=VERMILION, ms=9, label='set-point x_d')
    axes.set(
        xlabel='x1 [state units]',
        ylabel='x2 [state units]',
    )
    axes.set_title(phase_portrait_title(centre.size), loc='left')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(loc='best', edgecolor='none', framealpha=0.85)
    axes.grid(alpha=0.3)


def _draw_tolerance(axes: Axes, centre: FloatArray, scenario: Scenario) -> None:
    """Where the first two states are within the tolerance: an ellipse, a strip, or everywhere."""
    weights, eps = scenario.error_weights[:2], scenario.objective.tolerance
    if np.all(weights > 0):
        angle = np.linspace(0, 2 * np.pi, 200)
        edge = eps / weights[:, None] * np.array([np.cos(angle), np.sin(angle)])
        axes.plot(*(centre[:2, None] + edge), '--', color=VERMILION, lw=1, label='eps ball')
        return
    for draw, middle, weight in zip((axes.axvline, axes.axhline), centre, weights, strict=False):
        if weight > 0:
            draw(middle - eps / weight, ls='--', color=VERMILION, lw=1, label='± eps')
            draw(middle + eps / weight, ls='--', color=VERMILION, lw=1)


def _draw_events(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    stride = max(1, len(trace.events) // _MOST_RASTER_EVENTS)
    times, pixels = trace.event_times_s[::stride], trace.event_pixels[::stride]
    polarity = trace.events['polarity'][::stride]
    for value, colour, name in ((1, VERMILION, 'ON (+1)'), (-1, BLUE, 'OFF (-1)')):
        chosen = polarity == value
        axes.scatter(
            times[chosen],
            pixels[chosen],
            s=14,
            marker='|',
            color=colour,
            label=name,
            rasterized=len(times) > _MOST_VECTOR_EVENTS,
        )
    axes.set(xlabel='time [s]', ylabel='pixel [row-major number]')
    _show_whole_time(axes, trace)
    pixel_count = trace.luminosities.shape[1]
    axes.set_ylim(-0.6, pixel_count - 0.4)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    _head(axes, 'Events', handletextpad=0)


def _draw_estimate(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    axes.plot(trace.times_s, trace.luminosities[:, 0], color=GREY, lw=1.4, label='luminosity y')
    axes.step(
        trace.times_s, trace.estimates[:, 0], where='post', color=BLUE, lw=0.9, label='estimate z'
    )
    axes.set(xlabel='time [s]', ylabel='luminosity [luminosity units]')
    _show_whole_time(axes, trace)
    _head(axes, 'Estimate of pixel 0')
    axes.grid(alpha=0.3)


def _draw_command(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    for i, colour in zip(range(trace.commands.shape[1]), _CYCLE, strict=False):
        axes.step(
            trace.times_s,
            trace.commands[:, i],
            where='post',
            color=colour,
            lw=0.9,
            label=f'u{i + 1}',
        )
    axes.set(xlabel='time [s]', ylabel='command u_o [input units]')
    _show_whole_time(axes, trace)
    _head(axes, 'Command')
    axes.grid(alpha=0.3)


def _draw_sector(axes: Axes, trace: Trace, scenario: Scenario, verdict: Verdict) -> None:
    relative = sector_ratio(
        trace.luminosities, trace.estimates, error_bound=1.0, dead_band=silent_below(scenario)
    )
    axes.plot(trace.times_s, np.fmax.reduce(relative, axis=1), color=BLUE, lw=0.9)
    axes.axhline(verdict.delta_z, color=VERMILION, ls='--', lw=1, label='sector bound delta_z')
    axes.set(xlabel='time [s]', ylabel='max |z - y| / |y|')
    _show_whole_time(axes, trace)
    _head(axes, 'Relative error of the estimate')
    axes.grid(alpha=0.3)


Drawer = Callable[[Axes, Trace, Scenario, Verdict], None]
_CYCLE = (BLUE, VERMILION, GREEN, GREY)
PANELS: dict[str, Drawer] = {
    'Error': _draw_error,
    'Phase portrait': _draw_phase_portrait,
    'Events': _draw_events,
    'Estimate': _draw_estimate,
    'Command': _draw_command,
    'Relative error of the estimate': _draw_sector,
}
