#!/usr/bin/env python3
"""Largest threshold at which a real sensor holds the tolerance: table, and a figure of it.

The sensor of config/real_sensor.yaml with 1 % of its packets lost, for its nine pixels, for one
pixel and for an integrator; with anchors, with intervals but without anchors, and with an
estimator that counts and takes the sensor for ideal.
"""

from __future__ import annotations

import argparse

import numpy as np
from checkout import ROOT, add_output
from matplotlib.figure import Figure

from dvs_common.output_folder import output_file
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_simulation.judging.measures import regulated
from dvs_simulation.sampled.real_sensor import LossyRun, worst_error

THRESHOLDS = np.arange(0.02, 0.261, 0.02)
SETTLED_S = {'nine pixels': 5.0, 'one pixel': 5.0, 'integrator': 15.0}
PLANTS: dict[str, dict[str, object]] = {
    'nine pixels': {},
    'one pixel': {'pixel_offsets': (0.0, 0.0), 'pixel_grid': (1, 1)},
    'integrator': {
        'state_matrix': (0.0,),
        'input_matrix': (1.0,),
        'output_vector': (1.0,),
        'pixel_offsets': tuple(np.linspace(0.9, 1.1, 9).tolist()),
        'pixel_grid': (3, 3),
        'initial_state': (0.25,),
        'set_point': (0.0,),
    },
}
ESTIMATORS: dict[str, dict[str, object]] = {
    'intervals and anchors': {},
    'intervals alone': {'frame_rate': 0.0},
    'counting': {'frame_rate': 0.0, 'threshold_uncertainty': (), 'leak_uncertainty': 0.0},
}


def errors(scenario: Scenario, run: LossyRun, thresholds: list[float]) -> list[float]:
    """Worst error at every threshold, up to the first that leaves the tolerance."""
    found: list[float] = []
    for h in thresholds:
        found.append(worst_error(scenario.replace(event_threshold=h), run))
        if not regulated(found[-1], scenario.objective.tolerance):
            break
    return found


def main() -> None:
    """Run all combinations, print the table and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output(parser)
    parser.add_argument('--duration', type=float, default=60.0, help='simulated seconds of a run')
    parser.add_argument('--quick', action='store_true', help='one threshold, to see it work')
    options = parser.parse_args()
    thresholds = THRESHOLDS[:1] if options.quick else THRESHOLDS
    scenario = load_scenario(ROOT / 'config' / 'real_sensor.yaml')
    figure = Figure(figsize=(10, 3.4), layout='constrained')
    panels = figure.subplots(1, len(PLANTS), sharey=True)
    print(f'| | {" | ".join(ESTIMATORS)} |\n|---{"|---" * len(ESTIMATORS)}|')
    for axes, (plant, changes) in zip(panels, PLANTS.items(), strict=True):
        run = LossyRun(duration=options.duration, settled=min(SETTLED_S[plant], options.duration))
        row = []
        for estimator, others in ESTIMATORS.items():
            worst = errors(scenario.replace(**changes, **others), run, thresholds.tolist())
            held = sum(regulated(error, scenario.objective.tolerance) for error in worst)
            row.append(f'{thresholds[held - 1]:.2f}' if held else 'none')
            axes.semilogy(thresholds[: len(worst)], np.minimum(worst, 0.5), 'o-', label=estimator)
        print(f'| {plant} | {" | ".join(row)} |', flush=True)
        axes.axhline(scenario.objective.tolerance, color='black', lw=0.8, ls='--')
        axes.set(title=plant, xlabel='event threshold h')
        axes.grid(alpha=0.3, which='both')
    panels[0].set(ylabel='worst ‖x − x_d‖ (dashed: ε)', ylim=(2e-3, 0.6))
    panels[0].legend(frameon=False, fontsize=8)
    figure.savefig(output_file(options.output, 'real_sensor.png'), dpi=110)


if __name__ == '__main__':
    main()
