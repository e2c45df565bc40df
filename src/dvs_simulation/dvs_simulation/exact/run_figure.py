"""The picture of an exact run: error, states, events, estimate over luminosity, command."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.drawing import Figure
from dvs_simulation import plotting
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.exact.signals import estimates_at, luminosities
from dvs_simulation.exact.trajectory import Trajectory
from dvs_simulation.judging.figure import phase_portrait_title
from dvs_simulation.judging.measures import error

_MOST_MARKS = 50_000


def run_figure(loop: ClosedLoop, run: Trajectory, *, tolerance: float, title: str) -> Figure:
    """Draw a run with samples.

    Parameters
    ----------
    loop
        What ran.
    run
        What came out.
    tolerance
        eps.
    title
        Heading.
    """
    figure, axes = plotting.new_figure(11, 11.4, rows=3, columns=2)
    figure.suptitle(title)
    times = run.sample_time
    errors = error(run.states, loop.equilibrium, loop.error_weights)
    axes[0, 0].semilogy(times, np.maximum(errors, 1e-12), color=plotting.BLUE, lw=1.2)
    plotting.draw_tolerance(axes[0, 0], tolerance)
    axes[0, 0].set(xlabel='time t [s]', ylabel=r'$\|x - x_d\|$ [unit of x]', title='Error')
    axes[0, 0].legend(loc='upper right')
    _draw_states(axes[0, 1], loop, run, tolerance)
    stride = max(1, len(run.event_time) // _MOST_MARKS)
    plotting.draw_events(
        axes[1, 0],
        run.event_time[::stride],
        run.event_pixel[::stride],
        run.event_polarity[::stride],
    )
    axes[1, 0].set(
        xlabel='time t [s]', ylabel='pixel number (row-major)', xlim=(0, times[-1]), title='Events'
    )
    axes[1, 0].yaxis.get_major_locator().set_params(integer=True)
    # Above the axes: the events of a long run fill every place inside.
    axes[1, 0].legend(
        loc='lower right', bbox_to_anchor=(1, 1), ncols=2, markerscale=2, borderaxespad=0
    )
    _draw_estimate(axes[1, 1], loop, run)
    _draw_command(axes[2, 0], run)
    _draw_mean_error(axes[2, 1], run)
    return figure


def _draw_command(axes: Any, run: Trajectory) -> None:
    for i, values in enumerate(run.inputs.T):
        axes.step(run.sample_time, values, where='post', lw=1, label=f'$u_{i + 1}$')
    axes.set(xlabel='time t [s]', ylabel='command $u_o$ [unit of u]', title='Command')
    axes.legend(loc='best')


def _draw_mean_error(axes: Any, run: Trajectory) -> None:
    axes.step(run.sample_time, run.drive, where='post', color=plotting.BLUE, lw=1)
    axes.set(
        xlabel='time t [s]', ylabel=r'mean of $\bar z_i$ [unit of y]', title="Controller's input"
    )


def _draw_states(axes: Any, loop: ClosedLoop, run: Trajectory, tolerance: float) -> None:
    if loop.model.state_count == 1:
        axes.plot(run.sample_time, run.states[:, 0], color=plotting.BLUE, lw=1.2)
        axes.set(xlabel='time t [s]', ylabel=r'$x_1$ [unit of x]', title='State')
        return
    axes.plot(*run.states.T[:2], color=plotting.BLUE, lw=1)
    axes.plot(*run.states[0, :2], 'o', color=plotting.GREEN, ms=6, label=r'start $x_0$')
    plotting.draw_ball(axes, loop.equilibrium.state, tolerance)
    axes.set(
        xlabel=r'$x_1$ [unit of x]',
        ylabel=r'$x_2$ [unit of x]',
        title=phase_portrait_title(loop.model.state_count),
    )
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(loc='best')


def _draw_estimate(axes: Any, loop: ClosedLoop, run: Trajectory) -> None:
    times = run.sample_time
    first = slice(0, 1)
    y = luminosities(loop, run.states)[:, first]
    z = estimates_at(loop, run, times)[:, first]
    axes.plot(times, y, color=plotting.GREY, lw=1.4, label='luminosity $y_1$')
    axes.step(times, z, where='post', color=plotting.VERMILION, lw=1, label='estimate $z_1$')
    axes.set(xlabel='time t [s]', ylabel='luminosity [unit of y]', title='First pixel')
    axes.legend(loc='best')
