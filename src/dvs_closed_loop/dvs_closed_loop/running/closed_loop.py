"""Command `closed_loop`: run a scenario as separate nodes, watch it, judge it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dvs_closed_loop.bags.bag import read_bag
from dvs_closed_loop.bags.recorded_run import RecordedRun, examine
from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.bags.reported_budgets import reported_budgets
from dvs_closed_loop.bags.streams import STREAMS
from dvs_closed_loop.running.earlier_results import kept_aside
from dvs_closed_loop.running.loop_plan import MOVABLE_ROLES, given, loop_plan
from dvs_closed_loop.running.loop_runner import LoopError, run_loop
from dvs_closed_loop.running.run_recorder import RECORDED, RunRecorder
from dvs_common.errors import SuiteError
from dvs_common.node.node_plan import checked_namespace
from dvs_common.node.session import RosSession, ros_session
from dvs_common.output_folder import output_folder
from dvs_common.program import importing
from dvs_common.scenario.parameters import CONTROLLER
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.wire import topics
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.trace import IncompleteTraceError, decode_trace
from dvs_simulation.judging.unjudged import Unjudged, without_states
from dvs_simulation.judging.verdict import Verdict, judge

# Results of a run.
_OF_A_RUN = ('bag', 'result.json', 'figure.png', 'report.html', 'report.png')


class InterruptedEarly(Exception):
    """Ctrl-C before the first command: there is nothing to judge."""


def run_scenario(
    parameter_file: Path,
    output: Path,
    session: RosSession,
    *,
    parameters: Mapping[str, object] | None = None,
    namespace: str = '',
    elsewhere: Collection[str] = (),
    composed: bool = False,
) -> Verdict | Unjudged:
    """Run a scenario and write bag, result and figure into `output`.

    A plant that publishes no state leaves bag and result, and no figure.

    Parameters
    ----------
    parameter_file
        The scenario.
    output
        Folder for the results of this scenario; a former run's results in it are replaced when
        this one has begun.
    session
        Turns what observes the loop; a signal ends the run early.
    parameters
        Values that differ from the file.
    namespace
        Namespace of the whole loop; empty for none.
    elsewhere
        Nodes that are started elsewhere, as on another machine.
    composed
        Whether the three nodes share one process.

    Raises
    ------
    SuiteError
        If the scenario is not sound, a node fails or messages were lost.
    InterruptedEarly
        If a signal comes before the first command.
    """
    parameters = dict(parameters or {})
    space = checked_namespace(namespace)
    scenario = load_scenario(parameter_file, namespace=space).replace(**parameters)
    controller_scenario = load_scenario(parameter_file, namespace=space, node=CONTROLLER)
    plans = loop_plan(
        scenario,
        parameter_file,
        namespace=namespace,
        parameters=parameters,
        elsewhere=elsewhere,
        composed=composed,
        plant_waits=True,
    )
    promised = Promised.of(design_from_scenario(controller_scenario.replace(**parameters)))
    if session.stop.received:
        raise InterruptedEarly
    output_folder(output)
    bag_path = output / 'bag'
    with kept_aside(output, _OF_A_RUN) as begin:
        with BagWriter(bag_path, {topic: STREAMS[topic].type_name for topic in RECORDED}) as bag:
            bag.keep_scenario(scenario, parameter_file.stem)
            recorder = run_loop(scenario, plans, bag, session, begin=begin)
        if session.stop.received and not recorder.messages[topics.COMMAND]:
            raise InterruptedEarly
    run = _FinishedRun(
        scenario=scenario,
        name=parameter_file.stem,
        promised=promised,
        recorder=recorder,
        reported=reported_budgets(recorder.messages[topics.DIAGNOSTICS], space),
        interrupted=session.stop.received,
    )
    try:
        return run.judged(bag_path, output) if recorder.publishes_states else run.unjudged(output)
    except IncompleteTraceError as error:
        raise LoopError(f'the recording is incomplete: {error}') from None


@dataclass(frozen=True, slots=True, kw_only=True)
class _FinishedRun:
    """A run that has come to its end, and what its design promised."""

    scenario: Scenario
    name: str
    promised: Promised
    recorder: RunRecorder
    reported: Sequence[Budget]
    interrupted: bool

    def unjudged(self, output: Path) -> Unjudged:
        """Write what is known without the states."""
        unjudged = without_states(
            self.recorder.messages,
            self.scenario,
            name=self.name,
            delta_certified=self.promised.delta_certified,
            interrupted=self.interrupted,
            reported=self.reported,
        )
        unjudged.save(output / 'result.json')
        return unjudged

    def judged(self, bag_path: Path, output: Path) -> Verdict:
        """Write the verdict and the figure."""
        bounds = None
        try:
            trace = decode_trace(self.recorder.messages)
        except IncompleteTraceError:
            recorded = self._recorded(bag_path)
            if recorded is None or recorded.trace is None:
                raise
            trace = recorded.trace
            bounds = None if recorded.from_start else self.scenario.model_reference_bounds
        verdict = judge(
            trace,
            self.scenario,
            name=self.name,
            promised=self.promised,
            wall_seconds=self.recorder.wall_seconds,
            interrupted=self.interrupted,
            bounds=bounds,
            reported=self.reported,
        )
        verdict.save(output / 'result.json')
        # Matplotlib takes longer to load than a loop to start.
        with importing():
            from dvs_simulation.judging.figure import save_figure
        save_figure(trace, self.scenario, verdict, output / 'figure.png')
        return verdict

    def _recorded(self, bag_path: Path) -> RecordedRun | None:
        """What the bag has of a run that was cut off, or began by itself; others must be whole."""
        may_lack_an_end = self.interrupted or not self.recorder.plant_waited
        return examine(read_bag(bag_path)) if may_lack_an_end else None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='closed_loop',
        description='Run a scenario as three ROS 2 nodes, record and judge it. The exit code is '
        '0 if the run regulated and the sector bound held (or was ended by Ctrl-C), 1 if not, and '
        '2 if a parameter or argument is wrong.',
    )
    parser.add_argument('--params-file', type=Path, required=True, help='scenario (YAML)')
    parser.add_argument(
        '--output', type=Path, default=Path('out'), help='folder of the results (out)'
    )
    parser.add_argument('--duration', type=float, help="simulated seconds, instead of the file's")
    parser.add_argument('--namespace', default='', help='namespace of the whole loop')
    parser.add_argument('--mode', help="lockstep or realtime, instead of the file's")
    parser.add_argument('--method', help="synthesis method, instead of the file's")
    parser.add_argument('--event-threshold', type=float, help="h, instead of the file's")
    parser.add_argument(
        '--elsewhere',
        nargs='+',
        default=(),
        choices=MOVABLE_ROLES,
        help='nodes that are started by hand, as on another machine',
    )
    parser.add_argument('--composed', action='store_true', help='three nodes in one process')
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `closed_loop`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    options = _parser().parse_args(arguments)
    output = options.output / options.namespace.strip('/') / options.params_file.stem
    try:
        with ros_session() as session:
            verdict = run_scenario(
                options.params_file,
                output,
                session,
                parameters=given(
                    duration=options.duration,
                    mode=options.mode,
                    method=options.method,
                    event_threshold=options.event_threshold,
                ),
                namespace=options.namespace,
                elsewhere=options.elsewhere,
                composed=options.composed,
            )
    except SuiteError as error:
        print(f'closed_loop: {error}', file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f'closed_loop: {error}', file=sys.stderr)
        return 1
    except InterruptedEarly:
        print('interrupted before the first command')
        return 0
    print(verdict)
    figure = ', figure.png' if isinstance(verdict, Verdict) else ''
    print(f'  results              {output}/  (bag, result.json{figure})')
    return 0 if verdict.passed or verdict.interrupted else 1
