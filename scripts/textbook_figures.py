#!/usr/bin/env python3
"""Runs the textbook plants and draws them: docs/figures/textbook_*.png."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from checkout import ROOT, add_output

from dvs_common.output_folder import output_folder
from dvs_common.scenario.scenario import load_scenario
from dvs_simulation.judging.figure import save_figure
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import judge
from dvs_simulation.sampled.sampled_loop import run_sampled

PLANTS = sorted((ROOT / 'config' / 'textbook').glob('*.yaml'))


def draw(file: Path, output: Path) -> None:
    """Run one scenario as the nodes do and draw it."""
    scenario = load_scenario(file)
    started = time.perf_counter()
    run = run_sampled(scenario)
    trace = decode_trace(run.messages)
    verdict = judge(
        trace,
        scenario,
        name=file.stem,
        promised=Promised.of(run.design),
        wall_seconds=time.perf_counter() - started,
        interrupted=False,
    )
    print(verdict)
    save_figure(trace, scenario, verdict, output / f'textbook_{file.stem}.png')


def main() -> None:
    """Draw all of them, or the first."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_output(parser)
    parser.add_argument('--quick', action='store_true', help='one plant, to see it work')
    options = parser.parse_args()
    output = output_folder(options.output)
    for file in PLANTS[-1:] if options.quick else PLANTS:
        draw(file, output)


if __name__ == '__main__':
    main()
