#!/usr/bin/env python3
"""Draws h* and h_certified against the bandwidth limit: docs/figures/bandwidth_trade.png."""

from __future__ import annotations

import argparse

import numpy as np
from checkout import ROOT, add_output
from matplotlib.figure import Figure

from dvs_common.arrays import FloatArray
from dvs_common.output_folder import output_file
from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.design import DesignFigures, design_controller
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.options import DesignOptions

LIMITS = np.geomspace(20, 500, 10)
COLOURS = {'unstructured': '#0072B2', 'structured': '#D55E00', 'certified': '#009E73'}


def sweep(problem: DesignProblem, method: str, limits: FloatArray) -> list[DesignFigures]:
    """Figures of `method` at every bandwidth limit."""
    return [
        design_controller(
            problem, method=method, options=DesignOptions(bandwidth_limit=float(limit))
        ).figures
        for limit in limits
    ]


def main() -> None:
    """Sweep the scenario mirror_r1 and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output(parser)
    parser.add_argument('--quick', action='store_true', help='one limit, to see it work')
    options = parser.parse_args()
    limits = LIMITS[:1] if options.quick else LIMITS
    problem = DesignProblem.from_scenario(load_scenario(ROOT / 'config' / 'mirror_r1.yaml'))
    figure = Figure(figsize=(8, 7), layout='constrained')
    thresholds, periods = figure.subplots(2, 1, sharex=True)
    for method, colour in COLOURS.items():
        figures = sweep(problem, method, limits)
        thresholds.semilogx(
            limits,
            [f.h_certified for f in figures],
            'o-',
            color=colour,
            label=f'{method}: h certified',
        )
        thresholds.semilogx(
            limits, [f.h_star for f in figures], '--', color=colour, label=f'{method}: h*'
        )
        periods.loglog(limits, [1e3 * f.max_sampling_period for f in figures], 'o-', color=colour)
    thresholds.set(
        ylabel='event threshold [log_b units]',
        ylim=(0, 0.25),
        title='What a slower loop costs (scenario mirror_r1)',
    )
    thresholds.legend(frameon=False, fontsize=8, ncols=3, loc='lower center')
    periods.set(xlabel='bandwidth_limit [rad/s]', ylabel='longest sampling period [ms]')
    for axes in (thresholds, periods):
        axes.grid(alpha=0.3, which='both')
    figure.savefig(output_file(options.output, 'bandwidth_trade.png'))


if __name__ == '__main__':
    main()
