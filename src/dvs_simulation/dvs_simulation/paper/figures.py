"""The paper's figures that hold data."""

from __future__ import annotations

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.drawing import Figure
from dvs_hinf_controller.state_space import state_response
from dvs_simulation import plotting
from dvs_simulation.exact.signals import estimates_at
from dvs_simulation.paper.experiments import (
    Experiment,
    worst_case_gain,
)
from dvs_simulation.paper.published import OPTIMIZATION, PIXEL_OFFSETS, TOLERANCE
from dvs_simulation.paper.table import optimal_spacing

METHOD_COLOURS = {
    'unstructured': plotting.BLUE,
    'structured': plotting.VERMILION,
    'certified': plotting.GREEN,
}
PIXEL_COLOURS = {1: plotting.ORANGE, 3: plotting.PURPLE, 9: plotting.BLACK}
ERROR = r'error $\|x^o(t) - x_d\|$ [unit of x]'
FREQUENCIES = np.geomspace(1e-1, 1e4, 600)


def pixel_grid() -> Figure:
    """Relative positions of the nine pixels (paper, figure "grid")."""
    figure, axes = plotting.new_figure(4.6, 4.4)
    axes.plot(*PIXEL_OFFSETS.T, 's', ms=26, color=plotting.SKY, mec=plotting.BLUE, mew=1.2)
    for number, (x, y) in enumerate(PIXEL_OFFSETS, start=1):
        axes.annotate(f'{number}', (x, y), ha='center', va='center', weight='bold')
    ticks = [-0.01, 0, 0.01]
    axes.set_xticks(ticks)
    axes.set_yticks(ticks)
    axes.set(
        xlim=(-0.016, 0.016),
        ylim=(-0.016, 0.016),
        xlabel=r'$\delta x_1$ [unit of x]',
        ylabel=r'$\delta x_2$ [unit of x]',
        title=r'Pixels $\delta x_1 \ldots \delta x_9$ on the image plane',
        aspect='equal',
    )
    return figure


def staircase(experiment: Experiment) -> Figure:
    """Zero-order hold of the events of one pixel (paper, figure "trans").

    Parameters
    ----------
    experiment
        Run with y > 0.
    """
    figure, axes = plotting.new_figure(7.2, 4.2)
    run, loop = experiment.run, experiment.loop
    until = 1.2
    shown = run.sample_time <= until
    times = run.sample_time[shown]
    axes.plot(
        times, experiment.luminosity[shown, 0], color=plotting.GREY, label='luminosity $y_1$'
    )
    edges = np.concatenate([[0.0], run.event_time[(run.event_pixel == 0)], [until]])
    edges = edges[edges <= until]
    z = estimates_at(loop, run, edges)[:, 0]
    axes.step(edges, z, where='post', color=plotting.BLACK, lw=1.2, label='estimate $z_1$')
    mine = (run.event_pixel == 0) & (run.event_time <= until)
    after = estimates_at(loop, run, run.event_time[mine])[:, 0]
    polarity = run.event_polarity[mine]
    for sign, face, colour, name in (
        (1, plotting.ON, plotting.ON, 'positive event'),
        (-1, 'white', plotting.OFF, 'negative event'),
    ):
        chosen = polarity == sign
        axes.plot(
            run.event_time[mine][chosen],
            after[chosen],
            'o',
            mfc=face,
            mec=colour,
            mew=1.4,
            ms=5.5,
            label=name,
        )
    axes.set(
        xlabel='time t [s]',
        ylabel='luminosity [unit of y]',
        xlim=(0, until),
        title='The estimator holds the last event: a staircase beside the luminosity',
    )
    axes.legend(loc='upper right')
    return figure


def sector_plot(spacing: float = 0.8) -> Figure:
    """Estimate against luminosity with the borders of the sector (paper, figure "sector").

    Parameters
    ----------
    spacing
        rho; drawn wide so that one can see it.
    """
    figure, axes = plotting.new_figure(6.4, 5.2)
    levels = spacing ** -np.arange(-5.0, 6.0)
    y = np.array([0.0, 4.0])
    axes.fill_between(y, y * spacing, y / spacing, color=plotting.PALE, lw=0, label='sector')
    axes.plot(
        y,
        y / spacing,
        color=plotting.BLACK,
        lw=1.2,
        label=r'borders $z = y\,/\rho$ and $z = \rho\, y$',
    )
    axes.plot(y, y * spacing, color=plotting.BLACK, lw=1.2)
    for k in range(1, len(levels) - 1):
        below, level, above = levels[k - 1 : k + 2]
        first = k == 1
        axes.plot(
            [level, above, above],
            [level, level, above],
            color=plotting.ON,
            lw=2,
            label='rising: positive transitions' if first else None,
        )
        axes.plot(
            [level, below, below],
            [level, level, below],
            color=plotting.OFF,
            lw=2,
            ls=(0, (4, 1.5)),
            label='falling: negative transitions' if first else None,
        )
    axes.set(
        xlim=(0, 3),
        ylim=(0, 3),
        xlabel='luminosity y [unit of y]',
        ylabel='estimate z [unit of y]',
        title=rf'The estimate never leaves its sector ($\lambda$ = 1, $\rho$ = {spacing:g})',
        aspect='equal',
    )
    axes.legend(loc='upper left')
    return figure


def optimization() -> Figure:
    """The least rho that meets a bound on the error (paper, figure "best_HM")."""
    bound, m, upper = (OPTIMIZATION[name] for name in ('error_bound', 'lower', 'upper'))
    best, estimate = optimal_spacing(bound, m, upper)
    figure, axes = plotting.new_figure(7.2, 4.4)
    rho = np.linspace(0.7, 0.999, 400)
    ceiling, floor = m * rho * (1 + bound), upper * (1 - bound) / rho
    axes.fill_between(
        rho,
        floor,
        ceiling,
        where=ceiling >= floor,
        color=plotting.PALE,
        lw=0,
        label=r'$\delta_z \leq \bar{\delta}$',
    )
    axes.plot(
        rho,
        ceiling,
        color=plotting.VERMILION,
        label=r'$\bar{\lambda} = m\rho\,(1 + \bar{\delta})$',
    )
    axes.plot(
        rho, floor, color=plotting.BLUE, label=r'$\bar{\lambda} = M(1 - \bar{\delta})\,/\,\rho$'
    )
    axes.plot(
        rho,
        2 * m * upper * rho / (upper + m * rho**2),
        color=plotting.BLACK,
        ls='--',
        label=r'$\bar{\lambda} = 2mM\rho\,/\,(M + m\rho^2)$',
    )
    axes.plot(best, estimate, 'o', color=plotting.BLACK, ms=7)
    axes.annotate(
        rf'$(\rho^*, \bar{{\lambda}}^*)$ = ({best:.4f}, {estimate:.4f})',
        (best, estimate),
        (0.765, 1.31),
        arrowprops={'arrowstyle': '-', 'color': plotting.BLACK, 'shrinkB': 5},
    )
    axes.set(
        xlabel=r'spacing $\rho = b^{-h}$ [1]',
        ylabel=r'$\bar{\lambda} = \lambda\, \hat{q}(0)$ [unit of y]',
        xlim=(0.7, 1.0),
        ylim=(0.78, 1.36),
        title=rf'Least $\rho$ for $\bar{{\delta}}$ = {bound:g}, m = {m:g}, M = {upper:g}',
    )
    axes.legend(loc='lower left')
    return figure


def errors(experiments: dict[str, Experiment], colours: dict[str, str], title: str) -> Figure:
    """Error against time, with the first second enlarged (paper, figures "one_and_three").

    Parameters
    ----------
    experiments
        Runs by their name in the legend.
    colours
        Their colours.
    title
        Title.
    """
    figure, axes = plotting.new_figure(7.6, 4.4, columns=2, width_ratios=(1, 1.6), sharey=True)
    for axis, window in zip(axes, ((0.0, 0.8), (0.8, 6.0)), strict=True):
        for name, experiment in experiments.items():
            chosen = (experiment.run.sample_time >= window[0]) & (
                experiment.run.sample_time <= window[1]
            )
            axis.plot(
                experiment.run.sample_time[chosen],
                experiment.error[chosen],
                color=colours[name],
                lw=1.3,
                label=name,
            )
        plotting.draw_tolerance(axis, TOLERANCE)
        axis.set(xlabel='time t [s]', xlim=window)
    axes[0].set(ylabel=ERROR, yscale='log', ylim=(5e-4, 0.9), title=title)
    handles, labels = axes[1].get_legend_handles_labels()
    axes[1].legend(handles, labels, loc='upper right', ncols=2)
    return figure


def phase_portrait(
    experiments: dict[str, Experiment], colours: dict[str, str], title: str
) -> Figure:
    """States against each other, with the neighbourhood of the set-point enlarged.

    Parameters
    ----------
    experiments
        Runs by their name in the legend.
    colours
        Their colours.
    title
        Title.
    """
    figure, axes = plotting.new_figure(8.2, 4.6, columns=2)
    first = next(iter(experiments.values()))
    centre = first.loop.equilibrium.state
    for axis in axes:
        for name, experiment in experiments.items():
            axis.plot(*experiment.run.states.T[:2], color=colours[name], lw=1.1, label=name)
        plotting.draw_ball(axis, centre, TOLERANCE)
        axis.set(xlabel=r'$x^o_1$ [unit of x]')
    axes[0].plot(*first.run.states[0, :2], 'o', color=plotting.BLACK, ms=5, label=r'start $x_0$')
    axes[0].set(ylabel=r'$x^o_2$ [unit of x]', title=title)
    axes[1].set(
        xlim=(centre[0] - 0.075, centre[0] + 0.075),
        ylim=(centre[1] - 0.075, centre[1] + 0.075),
        title='around the set-point',
    )
    for axis in axes:
        axis.set_aspect('equal', adjustable='datalim' if axis is axes[0] else 'box')
    axes[0].legend(loc='best', fontsize=8.5)
    return figure


def bode(experiments: dict[str, Experiment]) -> Figure:
    """Worst-case gain from D to x (paper, figure "bode").

    Parameters
    ----------
    experiments
        Runs by method.
    """
    figure, axes = plotting.new_figure(7.2, 4.2)
    for name, experiment in experiments.items():
        gain = worst_case_gain(experiment, FREQUENCIES)
        model = experiment.loop.model
        g = state_response(model, experiment.design.controller).response(FREQUENCIES)[:, :, 0]
        delta = float(experiment.loop.sector().error_bound.max())
        axes.semilogx(
            FREQUENCIES, _db(gain), color=METHOD_COLOURS[name], label=f'{name}, worst case'
        )
        axes.semilogx(
            FREQUENCIES,
            _db(delta * np.linalg.norm(g, axis=1)),
            color=METHOD_COLOURS[name],
            ls=':',
            label=rf'{name}, $\delta_z \|G\|$ without feedback of $\Delta$',
        )
    axes.set(
        xlabel=r'frequency $\omega$ [rad/s]',
        ylabel=r'$\max_{|\Delta_i| \leq \delta_z} \|G^{CL}_{Dx}(j\omega)\|$ [dB]',
        xlim=(FREQUENCIES[0], FREQUENCIES[-1]),
        ylim=(-60, 5),
        title='Worst-case gain from D to x, r = 3, h = 0.149',
    )
    axes.legend(loc='lower left')
    return figure


def _db(gain: FloatArray) -> FloatArray:
    return np.asarray(20 * np.log10(gain))
