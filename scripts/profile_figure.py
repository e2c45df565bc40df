#!/usr/bin/env python3
"""Prints the wall of config/printed_wall.yaml and draws its run: docs/figures/printed_wall.png."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from checkout import ROOT, add_output
from PIL import Image

from dvs_common.arrays import FloatArray
from dvs_common.output_folder import output_file
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_simulation import plotting
from dvs_simulation.judging.measures import error
from dvs_simulation.judging.trace import Trace, decode_trace
from dvs_simulation.sampled.sampled_loop import run_sampled

SCENARIO = ROOT / 'config' / 'printed_wall.yaml'
_COLUMNS, _ROWS = 512, 32
_GAMMA, _GRAIN, _SEED = 0.8, 3.0, 0


def print_wall(path: Path, low: float, high: float) -> None:
    """Save the picture: a wedge ``s^gamma`` with grain, in 8 bits."""
    middles = low + (high - low) * (np.arange(_COLUMNS) + 0.5) / _COLUMNS
    grain = np.random.default_rng(_SEED).normal(0, _GRAIN, (_ROWS, _COLUMNS))
    grey = np.clip(np.round(255 * middles**_GAMMA + grain), 0, 255)
    Image.fromarray(grey.astype(np.uint8)).save(path)


def draw(scenario: Scenario, path: Path) -> None:
    """Run the scenario; draw the profile with its line, and how far the run is from it."""
    trace = decode_trace(run_sampled(scenario).messages)
    with plotting.in_style():
        figure, (left, right) = plotting.new_figure(9.0, 3.6, columns=2)
        _draw_profile(left, scenario, trace)
        _draw_error(right, scenario, trace)
        plotting.save_figure(figure, path, dpi=120)


def _line(scenario: Scenario, positions: FloatArray) -> FloatArray:
    profile, line, at = scenario.scene.profile, scenario.linearisation, _set_point(scenario)
    assert profile is not None
    return np.asarray(profile.luminosity(np.array(at)) + line.slope * (positions - at))


def _set_point(scenario: Scenario) -> float:
    return float(scenario.scene.positions(scenario.model, scenario.equilibrium.state).mean())


def _draw_profile(axes: Any, scenario: Scenario, trace: Trace) -> None:
    profile, line, at = scenario.scene.profile, scenario.linearisation, _set_point(scenario)
    assert profile is not None
    inside = at + np.linspace(-line.reach, line.reach, 2)
    axes.plot(profile.positions, profile.luminosities, label='profile: 32 stretches of the wall')
    axes.plot(inside, _line(scenario, inside), '--', label='line of the design')
    seen = trace.states @ scenario.model.output_vector + scenario.scene.brightness_offsets.mean()
    axes.plot(seen, profile.luminosity(seen), lw=4, alpha=0.4, label='seen in the run')
    axes.plot([at], [profile.luminosity(np.array(at))], 'ko', ms=4, label='set-point')
    axes.set(xlabel="c'(x + dx)", ylabel='luminosity')
    axes.legend()


def _draw_error(axes: Any, scenario: Scenario, trace: Trace) -> None:
    errors = error(trace.states, scenario.equilibrium, scenario.error_weights)
    axes.plot(trace.times_s, errors, label='||x - x_d||')
    plotting.draw_tolerance(axes, scenario.objective.tolerance)
    axes.set(xlabel='t [s]', ylim=(0, None))
    axes.legend()


def main() -> None:
    """Print the wall again and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output(parser)
    parser.add_argument('--wall', type=Path, help='print the wall into this file first')
    options = parser.parse_args()
    scenario = load_scenario(SCENARIO)
    if options.wall:
        print_wall(options.wall, *scenario.profile.profile_range)
        scenario = scenario.replace(brightness_profile=str(options.wall))
    draw(scenario, output_file(options.output, 'printed_wall.png'))


if __name__ == '__main__':
    main()
