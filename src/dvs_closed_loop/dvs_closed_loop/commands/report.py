"""Make figures and one self-contained HTML page of a recorded run, ours or by `ros2 bag`.

Of the recording of a sensor, a driver's bag or a file, it is a figure of rates and of pixels.

The scenario is the one stored in the bag, unless --params-file names another. Written beside the
bag unless --output names a folder. The exit code is 0 if the report was made.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from dvs_closed_loop.commands.bag_arguments import add_bag_arguments, chosen_bag

if TYPE_CHECKING:
    from dvs_closed_loop.bags.bag import RecordedBag
    from dvs_closed_loop.bags.recorded_run import RecordedRun
    from dvs_common.scenario.scenario import Scenario
    from dvs_simulation.judging.verdict import Verdict


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `report`.

    Parameters
    ----------
    parser
        Parser to extend.
    """
    add_bag_arguments(parser)
    parser.add_argument('--params-file', type=Path, help='scenario (default: that of the bag)')
    parser.add_argument('--output', type=Path, help='folder of the results (that of the bag)')


def run(options: argparse.Namespace) -> int:
    """Write the report; returns the exit code.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    SuiteError
        If the bag can't be read, or its scenario is not known.
    """
    from dvs_closed_loop.bags.recorded_run import examine
    from dvs_closed_loop.reports.report_page import report_page
    from dvs_common.errors import ParameterError
    from dvs_common.scenario.scenario import load_scenario
    from dvs_common.writing import write_text
    from dvs_event_camera.files.open_recording import is_sensor_recording
    from dvs_simulation.judging.figure import PANELS, panel_svg, save_figure

    if options.params_file is None and is_sensor_recording(options.bag):
        return _report_sensor(options)
    bag = chosen_bag(options)
    scenario = load_scenario(options.params_file) if options.params_file else bag.scenario
    name = options.params_file.stem if options.params_file else bag.scenario_name
    recorded = examine(bag)
    if scenario is None:
        raise ParameterError(
            'params-file', None, f'is needed: {options.bag} does not hold its scenario'
        )
    verdict = _judged(bag, recorded, scenario, name)
    output = _folder(options, name)
    figures = {}
    if recorded.trace is not None and verdict is not None:
        figures = {title: panel_svg(title, recorded.trace, scenario, verdict) for title in PANELS}
        save_figure(recorded.trace, scenario, verdict, output / 'report.png')
    page = output / 'report.html'
    write_text(
        page,
        report_page(
            bag=bag,
            recorded=recorded,
            scenario=scenario,
            name=name,
            verdict=verdict,
            figures=figures,
        ),
    )
    print(verdict or _unjudged(recorded, scenario, name))
    for line in recorded.troubles:
        print(f'  note                 {line}')
    print(f'  report               {page}')
    return 0


def _folder(options: argparse.Namespace, name: str) -> Path:
    from dvs_common.output_folder import output_folder

    if options.output is None:
        return output_folder(options.bag.parent)
    # The name of a scenario in a bag may be any text.
    return output_folder(options.output / (re.sub(r'[^\w.-]+', '_', name).strip('.') or 'bag'))


def _report_sensor(options: argparse.Namespace) -> int:
    from dvs_closed_loop.reports.sensor_report import report_sensor
    from dvs_event_camera.files.open_recording import open_recording

    given = dict(pair.split(':=', 1) for pair in options.topic if ':=' in pair)
    recording = open_recording(options.bag, given.get('events'))
    damage = report_sensor(recording, _folder(options, options.bag.stem))
    if damage:
        raise damage
    return 0


def _unjudged(recorded: RecordedRun, scenario: Scenario, name: str) -> str:
    from dvs_common.wire import topics
    from dvs_hinf_controller.design.design import design_from_scenario
    from dvs_simulation.judging.unjudged import without_states

    if not recorded.without_states.get(topics.COMMAND):
        return f'{name}: no sample was recorded whole, so there is no verdict'
    figures = without_states(
        recorded.without_states,
        scenario,
        name=name,
        delta_certified=design_from_scenario(scenario).figures.delta_certified,
        interrupted=False,
    )
    return str(figures)


def _judged(
    bag: RecordedBag, recorded: RecordedRun, scenario: Scenario, name: str
) -> Verdict | None:
    from dvs_closed_loop.bags.reported_budgets import reported_budgets
    from dvs_common.wire import topics
    from dvs_hinf_controller.design.design import design_from_scenario
    from dvs_simulation.judging.promised import Promised
    from dvs_simulation.judging.verdict import judge

    trace = recorded.trace
    if trace is None:
        return None
    design = design_from_scenario(scenario)
    simulated_s = float(trace.times_s[-1])
    return judge(
        trace,
        scenario,
        name=name,
        promised=Promised.of(design),
        wall_seconds=recorded.wall_seconds,
        interrupted=simulated_s < scenario.loop.duration - 1.5 * scenario.loop.sampling_period,
        bounds=None if recorded.from_start else scenario.model_reference_bounds,
        reported=reported_budgets(bag.of(topics.DIAGNOSTICS), bag.namespace),
        unrecorded=recorded.unrecorded,
    )
