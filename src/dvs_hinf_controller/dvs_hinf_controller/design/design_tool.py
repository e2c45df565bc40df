"""Console tool `design_controller`: which controller, which event threshold, which promise."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dvs_common.errors import ParameterError, SuiteError
from dvs_common.output_folder import output_file
from dvs_common.scenario.parameters import CONTROLLER
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_hinf_controller.analysis.margins import margins
from dvs_hinf_controller.design.design import (
    Design,
    design_from_scenario,
    save_design,
)
from dvs_hinf_controller.design.design_file import finite_or_null
from dvs_hinf_controller.design.design_report import as_json_object, promise_text, report_text
from dvs_hinf_controller.design.design_warnings import (
    RunningLoop,
    design_warnings,
    luminosity_warnings,
)
from dvs_hinf_controller.design.figure_words import threshold_words
from dvs_hinf_controller.design.pareto import UNITS, ParetoPoint, pareto
from dvs_hinf_controller.design.running_bounds import RunningBounds
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.methods import method_names
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError

_DEFAULT_EXTENT = 0.01


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tool.

    Parameters
    ----------
    arguments
        Command line without the program's name; the process's own if left out.

    Returns
    -------
    int
        0; 1 if there is no controller; 2 if an argument or parameter is wrong.
    """
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.pareto and (options.compare or options.json or options.output or options.figure):
        parser.error('--pareto writes its own table and figure: give it alone')
    if options.compare and options.output:
        parser.error('--output saves one design: name its --method instead of --compare')
    try:
        _run(options)
    except SuiteError as error:
        print(f'design_controller: {error}', file=sys.stderr)
        return error.exit_code
    return 0


def with_pixels(scenario: Scenario, grid: str) -> Scenario:
    """Scenario seen by a regular grid of pixels instead of its own.

    The grid keeps the scenario's pixel_pitch; where there is none it spans the extent of the
    scenario's own displacements.

    Parameters
    ----------
    scenario
        Checked parameters.
    grid
        ``HxW``: rows and columns.

    Raises
    ------
    ParameterError
        If `grid` is malformed.
    """
    match = re.fullmatch(r'([1-9]\d*)x([1-9]\d*)', grid)
    if match is None:
        raise ParameterError('pixels', grid, 'must be HEIGHTxWIDTH, for instance 720x1280')
    height, width = int(match[1]), int(match[2])
    pitch = scenario.pixels.pixel_pitch or _spanning_pitch(scenario, height, width)
    return scenario.replace(pixel_offsets=(), pixel_pitch=pitch, pixel_grid=(height, width))


def _spanning_pitch(scenario: Scenario, height: int, width: int) -> tuple[float, ...]:
    n = scenario.model.state_count
    extent = float(np.max(np.abs(scenario.pixels.pixel_offsets), initial=0.0)) or _DEFAULT_EXTENT
    pitch = np.zeros((2, n))
    pitch[0, 0] = 2 * extent / max(width - 1, 1)
    pitch[1, min(1, n - 1)] = 2 * extent / max(height - 1, 1)
    return tuple(pitch.ravel().tolist())


def _run(options: argparse.Namespace) -> None:
    scenario = load_scenario(options.params_file, node=CONTROLLER)
    if options.pixels:
        scenario = with_pixels(scenario, options.pixels)
    if options.method:
        scenario = scenario.replace(method=options.method)
    if options.tolerance is not None:
        scenario = scenario.replace(tolerance=options.tolerance)
    if options.threshold is not None:
        scenario = scenario.replace(event_threshold=options.threshold)
    if options.pareto:
        _pareto(scenario, options.pareto)
        return
    save_figure = _bode_figure() if options.figure else None
    designs = _compared(scenario) if options.compare else [design_from_scenario(scenario)]
    masked = scenario.uncertainty.pixel_mask
    used = [design.without_pixels(masked) for design in designs]
    _print(used, scenario, as_json=options.json, as_list=options.compare)
    if save_figure is not None:
        save_figure(designs, options.figure)
        print(f'Bode figure: {options.figure}', file=sys.stderr)
    if options.output:
        name = f'{Path(options.params_file).stem}-{designs[0].method}.json'
        path = output_file(options.output, name)
        save_design(designs[0], path)
        print(f'design: {path}', file=sys.stderr)


def _bode_figure() -> Callable[[Sequence[Design], Path], None]:
    """What draws it: matplotlib takes as long to load as all else, and may be missing."""
    from dvs_hinf_controller.design.bode_figure import save_bode_figure

    return save_bode_figure


def _pareto(scenario: Scenario, path: Path) -> None:
    # A missing matplotlib is reported before the designs.
    from dvs_hinf_controller.design.pareto_figure import save_pareto

    points: list[ParetoPoint] = []
    for point in pareto(scenario):
        if not points:
            print(f'{"parameter":<23} {"value":>10}  h_certified        h*')
        points.append(point)
        name = f'{point.parameter} [{UNITS[point.parameter]}]'
        h_certified, h_star = threshold_words(point.h_certified), threshold_words(point.h_star)
        row = f'{name:<23} {point.value:>10.4g}  {h_certified:>11}  {h_star:>8}'
        print(row, flush=True)
    picture = save_pareto(points, path)
    print(f'table: {path}, figure: {picture}', file=sys.stderr)


def _compared(scenario: Scenario) -> list[Design]:
    """Design of every method that finds one; the reason of each that does not is printed."""
    designs, failures = [], []
    for method in method_names():
        try:
            designs.append(design_from_scenario(scenario.replace(method=method)))
        except (SynthesisError, ParameterError) as error:
            failures.append(error)
            print(f'{method}: {error}', file=sys.stderr)
    if not designs:
        raise failures[0]
    return designs


def _print(designs: Sequence[Design], scenario: Scenario, *, as_json: bool, as_list: bool) -> None:
    h = scenario.sensor.event_threshold
    warnings = _warnings(designs, scenario)
    if as_json:
        objects = [
            {
                **as_json_object(design),
                'event_threshold': h,
                **RunningBounds.of(design, h).as_json_object(),
                'margins': _margins(design),
                'warnings': warnings[design.method],
            }
            for design in designs
        ]
        print(json.dumps(objects if as_list else objects[0], indent=1, allow_nan=False))
    else:
        _print_text(designs, scenario)
    for method, sentences in warnings.items():
        for sentence in sentences:
            print(f'warning: {method}: {sentence}', file=sys.stderr)


def _margins(design: Design) -> dict[str, float | None] | None:
    """Margins of the mean; None where there is no feedback, or more means than one."""
    model = design.problem.model
    if model.group_count > 1 or design.figures.state_peak_gain == 0:
        return None
    return finite_or_null(dataclasses.asdict(margins(model, design.controller)))


def _warnings(designs: Sequence[Design], scenario: Scenario) -> dict[str, list[str]]:
    loop, photoreceptor = RunningLoop.of_scenario(scenario), scenario.sensor.photoreceptor
    return {
        design.method: [
            *luminosity_warnings(design.problem, photoreceptor),
            *design_warnings(design, loop),
        ]
        for design in designs
    }


def _print_text(designs: Sequence[Design], scenario: Scenario) -> None:
    h = scenario.sensor.event_threshold
    print(report_text(designs, event_threshold=h))
    for design in designs:
        print('\n' + promise_text(design, h, command_limit=scenario.command_limit))
    problem: DesignProblem = designs[0].problem
    if problem.equilibrium.residual > 0:
        point = ', '.join(f'{value:.6g}' for value in problem.equilibrium.state)
        print(f'\nset-point used: [{point}], the nearest that the plant can hold')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='design_controller',
        description='Designs the controller of a scenario and reports what it promises.',
    )
    parser.add_argument('--params-file', required=True, metavar='FILE', help='scenario, YAML')
    parser.add_argument(
        '--method',
        metavar='METHOD',
        help=f"{', '.join(method_names())} or file; default: the scenario's method",
    )
    parser.add_argument(
        '--threshold', type=float, metavar='H', help='which tolerance does this h hold?'
    )
    parser.add_argument(
        '--tolerance', type=float, metavar='EPS', help="tolerance instead of the scenario's"
    )
    parser.add_argument('--compare', action='store_true', help='all methods side by side')
    parser.add_argument(
        '--pareto',
        type=Path,
        metavar='FILE',
        help='h against sampling period, latency and bandwidth: CSV file, and a figure beside it',
    )
    parser.add_argument('--json', action='store_true', help='print JSON (--compare: a list)')
    parser.add_argument(
        '--output',
        type=Path,
        help='folder of the results, or the JSON file: save the design, for design_file',
    )
    parser.add_argument('--figure', metavar='FILE', help='draw the Bode figure (.png, .svg, .pdf)')
    parser.add_argument(
        '--pixels', metavar='HxW', help="a regular pixel array instead of the scenario's"
    )
    return parser
