"""Figures of our corrections to the theory: positivity, small gain, the guarantee."""

from __future__ import annotations

from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.drawing import Axes, Figure
from dvs_hinf_controller.state_space import state_response
from dvs_simulation import plotting
from dvs_simulation.paper.experiments import (
    Counterexample,
    Experiment,
    ThresholdCurve,
)
from dvs_simulation.paper.figures import ERROR, FREQUENCIES, METHOD_COLOURS
from dvs_simulation.paper.published import TOLERANCE


def positivity(paper: Experiment, mirror: Experiment) -> Figure:
    """Luminosity of the printed example and of its mirror image.

    Parameters
    ----------
    paper
        Run of the example as printed.
    mirror
        Run of the mirror image.
    """
    figure, axes = plotting.new_figure(7.2, 4.0)
    for experiment, colour, name in (
        (paper, plotting.VERMILION, 'example as printed: changes its sign'),
        (mirror, plotting.BLUE, 'mirror image: physical'),
    ):
        axes.plot(
            experiment.run.sample_time, experiment.luminosity[:, 0], color=colour, label=name
        )
    axes.axhspan(-0.7, 0, color=plotting.PALE, lw=0, zorder=0)
    axes.text(2.95, -0.31, 'no real light', ha='right', color=plotting.GREY)
    axes.axhline(0, color=plotting.BLACK, lw=1)
    low = min(paper.luminosity[:, 0].min(), -0.3) * 1.15
    axes.set(
        xlabel='time t [s]',
        ylabel='luminosity $y_1$ [unit of y]',
        xlim=(0, 3),
        ylim=(low, None),
        title='The printed example needs negative luminosity',
    )
    axes.legend(loc='upper right')
    return figure


def counterexample_plot(counterexample: Counterexample) -> Figure:
    """Error of the counterexample against time, and its limsup against h.

    Parameters
    ----------
    counterexample
        The counterexample.
    """
    figure, axes = plotting.new_figure(8.6, 4.2, columns=2)
    for experiment, colour in zip(
        counterexample.experiments, (plotting.BLUE, plotting.VERMILION), strict=True
    ):
        shown = experiment.run.sample_time >= 15
        h = experiment.loop.event_threshold
        axes[0].plot(
            experiment.run.sample_time[shown],
            experiment.error[shown],
            color=colour,
            lw=1.1,
            label=f'h = {h:.2f}',
        )
        tail = experiment.run.tail
        assert tail is not None
        axes[1].plot(h, tail.peak, 'o', color=colour, ms=7, zorder=3)
    plotting.draw_tolerance(axes[0], TOLERANCE)
    axes[0].set(
        xlabel='time t [s]',
        ylabel=ERROR,
        xlim=(15, 30),
        ylim=(0, 0.085),
        title='Long after the start',
    )
    axes[0].legend(loc='upper center', ncols=2, fontsize=8.5)
    regular = np.isfinite(counterexample.sweep_limsup)
    top = 1.08 * float(counterexample.sweep_limsup[regular].max())
    axes[1].plot(
        counterexample.sweep_thresholds, counterexample.sweep_limsup, color=plotting.BLACK, lw=1.2
    )
    _mark_tolerance(axes[1], 0.34)
    axes[1].axvspan(
        counterexample.sweep_thresholds[regular].max(), 0.52, color=plotting.GREY, alpha=0.2, lw=0
    )
    axes[1].text(0.515, 0.97 * top, 'y reaches 0', ha='right', va='top', rotation=90, fontsize=9)
    for h, colour, name in (
        (counterexample.figures.h_certified, plotting.GREEN, 'guaranteed'),
        (counterexample.h_allowed, plotting.VERMILION, 'allowed by the theorems'),
    ):
        axes[1].axvline(h, color=colour, lw=1.5)
        right = h < 0.25
        axes[1].text(
            h + (0.008 if right else -0.008),
            0.97 * top if right else 0.2 * top,
            f'{name}\nh = {h:.3f}',
            color=colour,
            ha='left' if right else 'right',
            va='top',
        )
    axes[1].set(
        xlabel='event threshold h [1]',
        ylabel=r'limsup $\|x^o - x_d\|$ [unit of x]',
        xlim=(0, 0.52),
        ylim=(0, top),
        title='All thresholds',
    )
    return figure


def small_gain(counterexample: Counterexample, controller_gain: FloatArray) -> Figure:
    """``delta* ||Gw1(jw)||`` of the counterexample: below one at zero frequency only.

    Parameters
    ----------
    counterexample
        The counterexample.
    controller_gain
        ``||Gw1(jw)||`` on the common frequencies.
    """
    figure, axes = plotting.new_figure(7.2, 3.8)
    delta = counterexample.figures.delta_star
    axes.semilogx(FREQUENCIES, delta * controller_gain, color=plotting.VERMILION)
    axes.axhline(1, color=plotting.BLACK, ls='--', lw=1.1)
    axes.text(8e3, 1.02, 'small gain needs less than 1', ha='right', va='bottom')
    peak = int(np.argmax(controller_gain))
    value = delta * controller_gain[peak]
    axes.plot(FREQUENCIES[peak], value, 'o', color=plotting.VERMILION)
    axes.annotate(f'{value:.2f}', (FREQUENCIES[peak], value), (6, 4), textcoords='offset points')
    axes.set(
        xlabel=r'frequency $\omega$ [rad/s]',
        ylabel=r'$\delta^* \|G_{w_1}(j\omega)\|$ [1]',
        xlim=(FREQUENCIES[0], FREQUENCIES[-1]),
        ylim=(0, 1.15 * value),
        title='Small gain holds at zero frequency, not everywhere',
    )
    return figure


def counterexample_gain(counterexample: Counterexample) -> FloatArray:
    """``||Gw1(jw)||`` of the counterexample on the common frequencies.

    Parameters
    ----------
    counterexample
        The counterexample.
    """
    experiment = counterexample.experiments[0]
    model = experiment.loop.model
    g = state_response(model, experiment.design.controller).response(FREQUENCIES)[:, :, 0]
    return np.asarray(np.linalg.norm(model.gradient) * np.linalg.norm(g, axis=1))


def _mark_tolerance(axes: Axes, left: float) -> None:
    axes.axhline(TOLERANCE, color=plotting.BLACK, ls='--', lw=1.1)
    axes.text(left, TOLERANCE, rf'$\epsilon$ = {TOLERANCE:g}', va='bottom', fontsize=9)


def certificate(curves: list[ThresholdCurve]) -> Figure:
    """Simulated and guaranteed error against h.

    Parameters
    ----------
    curves
        One for each method.
    """
    figure, axes = plotting.new_figure(8.6, 4.2, columns=len(curves), sharey=True)
    for axis, curve in zip(axes, curves, strict=True):
        _draw_curve(axis, curve)
    axes[0].set_ylabel(r'limsup $\|x^o - x_d\|$ [unit of x]')
    axes[0].legend(loc='upper left', fontsize=8.5)
    return figure


def _draw_curve(axes: Axes, curve: ThresholdCurve) -> None:
    colour = METHOD_COLOURS[curve.design.method]
    figures = curve.design.figures
    axes.plot(curve.thresholds, curve.bound, color=colour, label='guaranteed')
    axes.plot(curve.thresholds, curve.limsup, '.', color=plotting.BLACK, ms=4, label='simulated')
    _mark_tolerance(axes, 0.006)
    # The one label where the bound has left room, the other under the simulated runs.
    marks: tuple[tuple[float, float, str, Any], ...] = (
        (figures.h_certified, TOLERANCE + 0.002, r'$h_\mathrm{cert}$', colour),
        (figures.h_star, 0.002, r'$h^*$', plotting.GREY),
    )
    for h, height, name, shade in marks:
        axes.plot([h, h], [0, TOLERANCE], color=shade, lw=1.4)
        axes.text(h + 0.012, height, f'{name} = {h:.3f}', color=shade, fontsize=9)
    axes.set(
        xlabel='event threshold h [1]', xlim=(0, 0.3), ylim=(0, 0.1), title=curve.design.method
    )
