#!/usr/bin/env python3
"""Draws what bench.sh measured by the size of the sensor: docs/figures/scale.png."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from bench_scale import SIZES
from checkout import ROOT, add_output
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dvs_common.output_folder import output_file

# Node, colour, marker.
NODES = (
    ('event_camera', '#0072B2', 'o'),
    ('hinf_controller', '#D55E00', 's'),
    ('plant_sim', '#009E73', '^'),
    ('composed_loop', '#555555', 'D'),
)
LOOPS = (('three', 'three processes', '#CC79A7', 'v'), ('composed', 'one process', '#555555', 'D'))


def draw(axes: Axes, figures: dict[str, float], key: str, name: str, **style: str) -> None:
    """Draw one figure against the number of pixels.

    Parameters
    ----------
    axes
        Where.
    figures
        All figures by their name.
    key
        Its name, with `{}` for the size.
    name
        What the legend calls it.
    **style
        Colour and marker.
    """
    points = [
        (width * height, figures[key.format(f'{width}x{height}')])
        for width, height in SIZES
        if key.format(f'{width}x{height}') in figures
    ]
    if points:
        axes.loglog(*zip(*points, strict=True), label=name, **style)


def per_cpu_second(figures: dict[str, float], label: str) -> dict[str, float]:
    """Cycles a CPU second of all processes of a loop, by size: other load hardly changes it.

    Parameters
    ----------
    figures
        All figures by their name.
    label
        `three` or `composed`.
    """
    rates = {}
    for width, height in SIZES:
        size = f'{width}x{height}'
        times = [
            value for key, value in figures.items() if key.startswith(f'scale_{size}_{label}_ms_')
        ]
        if times:
            rates[size] = 1e3 / sum(times)
    return rates


def main() -> None:
    """Read the figures and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = ROOT / 'docs' / 'benchmarks.json'
    parser.add_argument('--json', type=Path, default=default, help='figures of bench.sh')
    add_output(parser)
    options = parser.parse_args()
    figures = json.loads(options.json.read_text(encoding='utf-8'))
    figure = Figure(figsize=(7, 9), layout='constrained')
    rates, times, memory = figure.subplots(3, 1, sharex=True)
    for label, name, colour, marker in LOOPS:
        rate = per_cpu_second(figures, label)
        draw(rates, rate, '{}', name, color=colour, marker=marker)
    for node, colour, marker in NODES:
        label = 'composed' if node == 'composed_loop' else 'three'
        for axes, unit in ((times, 'ms'), (memory, 'mb')):
            key = f'scale_{{}}_{label}_{unit}_{node}'
            draw(axes, figures, key, node, color=colour, marker=marker)
    rates.set(ylabel='cycles a CPU second', title='Lockstep loop')
    times.set(ylabel='CPU time of a cycle [ms]')
    memory.set(ylabel='resident memory [MB]', xlabel='pixels')
    for axes in (rates, times, memory):
        axes.grid(True, which='major', alpha=0.3)
        axes.legend()
    output = output_file(options.output, 'scale.png')
    figure.savefig(output, dpi=120)
    print(output)


if __name__ == '__main__':
    main()
