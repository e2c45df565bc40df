"""Subcommand `simulate`: one scenario, exactly from event to event, or sampled as the nodes do."""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dvs_common.errors import ParameterError
from dvs_common.output_folder import output_folder
from dvs_common.scenario.loop_file import read_loop_values
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.writing import write_text
from dvs_hinf_controller.design.design import Design, design_from_scenario
from dvs_hinf_controller.design.design_file import finite_or_null
from dvs_simulation import plotting
from dvs_simulation.exact import ClosedLoop, Trajectory, simulate
from dvs_simulation.exact.run_figure import run_figure
from dvs_simulation.exact.signals import judged
from dvs_simulation.judging.measures import Judgement, error, settled_from, unsettled
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.words import outcome_word, threshold_or_null, threshold_text

if TYPE_CHECKING:
    from dvs_hinf_controller.analysis.budget import Budget
    from dvs_simulation.sampled.sampled_loop import SampledRun

# Samples of y and z that the sector is checked on; more pixels have fewer samples.
_MOST_SECTOR_VALUES = 4_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments.

    Parameters
    ----------
    parser
        Parser of the subcommand.
    """
    parser.add_argument('--params-file', type=Path, required=True, help='scenario (YAML)')
    parser.add_argument(
        '--output', type=Path, default=Path('out'), help='folder of the results (out)'
    )
    parser.add_argument('--duration', type=float, help='length of the run, s')
    parser.add_argument('--method', help="synthesis method in place of the scenario's")
    parser.add_argument('--event-threshold', type=float, help="h in place of the scenario's")
    parser.add_argument(
        '--sampled',
        action='store_true',
        help="the ROS loop without ROS: the nodes' cores in lockstep at sampling_period",
    )
    parser.add_argument('--sampling-period', type=float, help='with --sampled, s')


def run(options: argparse.Namespace) -> int:
    """Run the scenario; 0 only if it regulated and the sector bound held.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    SuiteError
        If the scenario is not sound, or has a plant of its own.
    """
    read_loop_values(options.params_file).require_alike()
    scenario = load_scenario(options.params_file)
    changes = {
        name: value
        for name in ('duration', 'method', 'event_threshold', 'sampling_period')
        if (value := getattr(options, name)) is not None
    }
    scenario = scenario.replace(**changes)
    if not scenario.has_linear_plant:
        raise ParameterError(
            'plant_executable',
            scenario.plant.plant_executable,
            'is not the linear plant, which alone is simulated here',
        )
    name = options.params_file.stem
    kind = 'sampled' if options.sampled else 'exact'
    output = output_folder(options.output / f'{name}-{kind}')
    if options.sampled:
        return _run_sampled(scenario, name, output)
    return _run_exact(scenario, name, output)


def _run_exact(scenario: Scenario, name: str, output: Path) -> int:
    scenario.model.require_one_group('simulate without --sampled')
    design = design_from_scenario(scenario)
    loop = ClosedLoop.from_scenario(scenario, design.controller)
    duration = float(scenario.loop.duration)
    count = max(2, min(6001, _MOST_SECTOR_VALUES // loop.pixel_count))
    started = time.process_time()
    trajectory = simulate(
        loop,
        duration=duration,
        sample_times=np.linspace(0, duration, count),
        tail_start=settled_from(duration),
    )
    seconds = time.process_time() - started
    judgement = judged(
        loop,
        trajectory,
        tolerance=design.problem.tolerance,
        output_tolerance=design.problem.output_tolerance,
    )
    result = exact_result(name, design, loop, trajectory, judgement, cpu_seconds=seconds)
    write_text(output / 'result.json', json.dumps(finite_or_null(result), indent=2) + '\n')
    with plotting.in_style():
        plotting.save_figure(
            run_figure(
                loop, trajectory, tolerance=scenario.objective.tolerance, title=_title(result)
            ),
            output / 'figure.png',
            dpi=120,
        )
    print(_summary(result, output))
    return 0 if judgement.passed else 1


def exact_result(
    name: str,
    design: Design,
    loop: ClosedLoop,
    trajectory: Trajectory,
    judgement: Judgement,
    *,
    cpu_seconds: float,
) -> dict[str, Any]:
    """Figures of an exact run, as in `result.json`.

    Parameters
    ----------
    name
        Name of the scenario.
    design
        Controller and its figures.
    loop
        What ran.
    trajectory
        What came out.
    judgement
        What decides on it.
    cpu_seconds
        CPU time of the simulation, s.
    """
    outcome, limsup = trajectory.outcome, judgement.limsup_error
    errors = error(trajectory.states, loop.equilibrium, loop.error_weights)
    figures, begin = design.figures, settled_from(outcome.time)
    settling = not judgement.regulated and unsettled(
        limsup,
        judgement.tolerance,
        transient=Promised.of(design).transient(
            loop.initial_state - loop.equilibrium.state, begin, outcome.time
        ),
    )
    # The continuous loop has a certificate of its own, in which nothing acts on it.
    h_certified = min(figures.h_certified, figures.h_certified_continuous)
    acts = loop.output_disturbance or (loop.load is not None and np.any(loop.load))
    return {
        'scenario': name,
        'mode': 'exact',
        'regulated': judgement.regulated,
        'outcome': outcome.status,
        'message': outcome.message,
        'tolerance': judgement.tolerance,
        'final_error': float(errors[-1]),
        'limsup_error': limsup if np.isfinite(limsup) else None,
        'sector_ratio_max': judgement.sector_ratio_max,
        'pixels': loop.pixel_count,
        'events': trajectory.event_count,
        'events_per_pixel': trajectory.event_count / loop.pixel_count,
        'simulated_seconds': outcome.time,
        'cpu_seconds': cpu_seconds,
        'evaluations': trajectory.evaluations,
        'h': loop.event_threshold,
        'h_star': threshold_or_null(figures.h_star),
        'h_certified': threshold_or_null(h_certified),
        'certified': loop.event_threshold <= h_certified and not acts,
        'settling': settling,
        'slowest_pole': figures.closed_loop_abscissa,
    }


def _title(result: dict[str, Any]) -> str:
    word = 'NOT regulated: broken off'
    if result['outcome'] == 'completed':
        word = outcome_word(
            regulated=result['regulated'],
            slowest_pole=result['slowest_pole'] if result['settling'] else None,
            duration_s=result['simulated_seconds'],
        )
    promise = 'promised' if result['certified'] else 'nothing promised'
    return (
        f'{result["scenario"]}: {word}, r = {result["pixels"]}, h = {result["h"]:g} '
        f'({promise}; h_certified = {threshold_text(result["h_certified"])}, '
        f'h* = {threshold_text(result["h_star"])}), {result["events"]} events'
    )


def _summary(result: dict[str, Any], output: Path) -> str:
    limsup = result['limsup_error']
    return '\n'.join(
        (
            _title(result),
            f'  {result["message"]}',
            f'  limsup ||x - x_d||   {"-" if limsup is None else f"{limsup:.6f}"}   '
            f'(bound over the last third; eps = {result["tolerance"]:g})',
            f'  sector bound         worst |z - y| / (delta_z |y|) = '
            f'{result["sector_ratio_max"]:.6f}',
            f'  work                 {result["cpu_seconds"]:.4f} CPU s',
            f'  written              {output / "result.json"}, {output / "figure.png"}',
        )
    )


def _run_sampled(scenario: Scenario, name: str, output: Path) -> int:
    from dvs_simulation.judging.figure import save_figure
    from dvs_simulation.judging.trace import decode_trace
    from dvs_simulation.judging.verdict import judge
    from dvs_simulation.sampled.sampled_loop import run_by_messages

    started = time.perf_counter()
    scenario = scenario.replace(mode='lockstep')  # whatever the nodes would do
    sampled = run_by_messages(scenario)
    assert sampled.controller is not None
    trace = decode_trace(sampled.messages)
    verdict = judge(
        trace,
        scenario,
        name=name,
        promised=Promised.of(sampled.design),
        wall_seconds=time.perf_counter() - started,
        interrupted=False,
        reported=_budgets(sampled),
    )
    verdict.save(output / 'result.json')
    save_figure(trace, scenario, verdict, output / 'figure.png')
    print(verdict)
    print(f'  written              {output / "result.json"}, {output / "figure.png"}')
    return 0 if verdict.passed else 1


def _budgets(sampled: SampledRun) -> list[Budget]:
    """The worst of the run, by the certificates of the pixels of its start and of its end."""
    from dvs_hinf_controller.design.design import measure

    assert sampled.controller is not None
    design, references = sampled.design, sampled.controller.references
    budget = sampled.controller.read_budget(design.figures.delta_certified)
    used = references.health.healthy
    if not design.problem.sees_all_groups(used):
        return [budget, dataclasses.replace(budget, delta_certified=0.0)]
    left = design.problem.of_pixels(used)
    if left.scene.pixel_count == design.figures.pixels:
        return [budget]
    at_end = measure(left, design.controller).delta_certified
    return [budget, dataclasses.replace(budget, delta_certified=at_end)]
