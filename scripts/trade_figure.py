#!/usr/bin/env python3
"""Draws h* and h_certified against the bandwidth limit: docs/figures/bandwidth_trade.png."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

root = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(root / 'src' / name) for name in ('dvs_common', 'dvs_hinf_controller')]

import numpy as np  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from dvs_common.scenario.scenario import load_scenario  # noqa: E402
from dvs_hinf_controller.design.design import DesignFigures, design_controller  # noqa: E402
from dvs_hinf_controller.problem import DesignProblem  # noqa: E402
from dvs_hinf_controller.synthesis.options import DesignOptions  # noqa: E402

LIMITS = np.geomspace(20, 500, 10)
COLOURS = {'unstructured': '#0072B2', 'structured': '#D55E00', 'certified': '#009E73'}


def sweep(problem: DesignProblem, method: str) -> list[DesignFigures]:
    """Figures of `method` at every bandwidth limit."""
    return [
        design_controller(
            problem, method=method, options=DesignOptions(bandwidth_limit=float(limit))
        ).figures
        for limit in LIMITS
    ]


def main() -> None:
    """Sweep the scenario mirror_r1 and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = root / 'docs' / 'figures' / 'bandwidth_trade.png'
    parser.add_argument('--output', type=Path, default=default, help='image file')
    output = parser.parse_args().output
    problem = DesignProblem.from_scenario(load_scenario(root / 'config' / 'mirror_r1.yaml'))
    figure = Figure(figsize=(8, 7), layout='constrained')
    thresholds, periods = figure.subplots(2, 1, sharex=True)
    for method, colour in COLOURS.items():
        figures = sweep(problem, method)
        thresholds.semilogx(
            LIMITS,
            [f.h_certified for f in figures],
            'o-',
            color=colour,
            label=f'{method}: h certified',
        )
        thresholds.semilogx(
            LIMITS, [f.h_star for f in figures], '--', color=colour, label=f'{method}: h*'
        )
        periods.loglog(LIMITS, [1e3 * f.max_sampling_period for f in figures], 'o-', color=colour)
    thresholds.set(
        ylabel='event threshold [log_b units]',
        ylim=(0, 0.25),
        title='What a slower loop costs (scenario mirror_r1)',
    )
    thresholds.legend(frameon=False, fontsize=8, ncols=3, loc='lower center')
    periods.set(xlabel='bandwidth_limit [rad/s]', ylabel='longest sampling period [ms]')
    for axes in (thresholds, periods):
        axes.grid(alpha=0.3, which='both')
    output.parent.mkdir(exist_ok=True)
    figure.savefig(output)


if __name__ == '__main__':
    main()
