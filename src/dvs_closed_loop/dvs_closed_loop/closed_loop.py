"""Command `closed_loop`: run a scenario as separate nodes, watch it, judge it."""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from tqdm import tqdm

from dvs_closed_loop.bag import read_bag
from dvs_closed_loop.figure import save_figure
from dvs_closed_loop.loop_plan import MOVABLE_ROLES, given, loop_plan
from dvs_closed_loop.processes import NodeProcess
from dvs_closed_loop.recorded_run import examine
from dvs_closed_loop.recording import BagWriter
from dvs_closed_loop.run_recorder import RECORDED, RunRecorder
from dvs_closed_loop.streams import STREAMS
from dvs_closed_loop.trace import IncompleteTraceError, Trace, decode_trace
from dvs_closed_loop.verdict import Verdict, judge
from dvs_hinf_controller.design import design_from_scenario
from dvs_interfaces import topics
from dvs_interfaces.errors import SuiteError
from dvs_interfaces.messages import parse_command
from dvs_interfaces.node_plan import NodePlan
from dvs_interfaces.parameters import CAMERA, CONTROLLER
from dvs_interfaces.scenario import Scenario, load_scenario
from dvs_interfaces.spin import StopSignal

# Files beside a bag that tell of the run in it.
_OF_A_RUN = ('result.json', 'figure.png', 'report.html', 'report.png')
_START_TIMEOUT_S = 30.0
# After discovery in the graph, endpoints still need a moment to be matched on both sides.
_SETTLE_S = 0.3
# The run is heard to its end when nothing more arrives for a while; what was lost on the way is
# sent again when the middleware next asks for it, every 3 s.
_QUIET_S = 0.3
_REPAIR_S = 7.0
_ASK_PERIOD_S = 0.5


class LoopError(SuiteError):
    """A loop that could not start or broke off."""


class InterruptedEarly(Exception):
    """Ctrl-C before the first command: there is nothing to judge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopRun:
    """What remains of a run.

    Parameters
    ----------
    trace
        Signals of the run.
    verdict
        Its figures.
    """

    trace: Trace
    verdict: Verdict


class LoopRunner:
    """Starts the nodes of one scenario, lets them run and stops them.

    Parameters
    ----------
    scenario
        Checked parameters.
    plans
        What to start; the plant is the last and waits to be activated.
    """

    def __init__(self, scenario: Scenario, plans: Sequence[NodePlan]) -> None:
        self._scenario = scenario
        self._plans = plans
        self._processes: list[NodeProcess] = []

    def run(self, bag: BagWriter, stop: StopSignal) -> RunRecorder:
        """Run the loop to its end or until `stop`; the nodes are gone afterwards.

        Parameters
        ----------
        bag
            Where the messages go.
        stop
            Ends the run early.

        Raises
        ------
        LoopError
            If a node fails, or the nodes do not find each other in time.
        """
        node = self._observer()
        executor = EventsExecutor()
        executor.add_node(node)
        recorder = RunRecorder(node, self._scenario['mode'], bag)
        try:
            for plan in self._plans:
                self._processes.append(NodeProcess(plan))
            self._start_plant(node, executor, recorder, stop)
            self._watch(executor, recorder, stop)
            return recorder
        finally:
            for process in reversed(self._processes):
                process.stop()
            executor.remove_node(node)
            executor.shutdown()
            node.destroy_node()

    def _observer(self) -> Node:
        plan = self._plans[-1]
        remappings = [part for old, new in plan.remappings for part in ('-r', f'{old}:={new}')]
        arguments = ['--ros-args', *remappings] if remappings else []
        return Node('closed_loop', namespace=plan.namespace or None, cli_args=arguments)

    def _start_plant(
        self, node: Node, executor: EventsExecutor, recorder: RunRecorder, stop: StopSignal
    ) -> None:
        client = node.create_client(ChangeState, 'plant_sim/change_state')
        self._wait(executor, stop, client.service_is_ready, 'plant_sim to answer')
        self._change_state(client, executor, stop, Transition.TRANSITION_CONFIGURE)
        self._wait(executor, stop, recorder.hears_every_node, 'all three nodes')
        self._meet_every_node(node, executor, stop)
        settled = time.monotonic() + _SETTLE_S
        self._wait(executor, stop, lambda: time.monotonic() > settled, 'discovery')
        self._change_state(client, executor, stop, Transition.TRANSITION_ACTIVATE)

    def _meet_every_node(self, node: Node, executor: EventsExecutor, stop: StopSignal) -> None:
        """Wait for an answer of every node: only one that has met us sends us its messages.

        The graph shows a node as soon as we have met it; that it has met us too may take seconds
        more, and in realtime mode what it publishes until then is lost to the recording.
        """
        started = {plan.executable for plan in self._plans}
        for name in sorted(started & {CAMERA, CONTROLLER}):
            client = node.create_client(GetParameters, f'{name}/get_parameters')
            met = _Answered(client)
            self._wait(executor, stop, met, f'{name} to answer')

    def _change_state(
        self, client: object, executor: EventsExecutor, stop: StopSignal, transition: int
    ) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        future = client.call_async(request)  # type: ignore[attr-defined]
        self._wait(executor, stop, future.done, 'plant_sim to change its state')
        if future.done() and not future.result().success:
            raise LoopError('plant_sim refused to start; its message is above')

    def _wait(
        self,
        executor: EventsExecutor,
        stop: StopSignal,
        condition: Callable[[], bool],
        awaited: str,
    ) -> None:
        deadline = time.monotonic() + _START_TIMEOUT_S
        while not condition() and not stop.received:
            if time.monotonic() > deadline:
                raise LoopError(f'waited {_START_TIMEOUT_S:g} s in vain for {awaited}')
            self._check_processes()
            executor.spin_once(timeout_sec=0.05)

    def _check_processes(self) -> None:
        for process in self._processes:
            if process.exit_code is not None:
                raise LoopError(f'{process.name} ended with exit code {process.exit_code}')

    def _watch(self, executor: EventsExecutor, recorder: RunRecorder, stop: StopSignal) -> None:
        plant = self._processes[-1]
        with _Progress(self._scenario['duration'], recorder) as progress:
            while plant.exit_code is None and not stop.received:
                for process in self._processes[:-1]:
                    if process.exit_code is not None:
                        raise LoopError(f'{process.name} ended with exit code {process.exit_code}')
                _spin_for(executor, 0.1)
                progress.update()
            if plant.exit_code:
                raise LoopError(f'{plant.name} ended with exit code {plant.exit_code}')
            self._hear_the_end(executor, recorder, stop)
            progress.update()

    def _hear_the_end(
        self, executor: EventsExecutor, recorder: RunRecorder, stop: StopSignal
    ) -> None:
        lockstep = self._scenario['mode'] == 'lockstep'
        samples = self._scenario.sample_count + 1 if lockstep else 0
        deadline = time.monotonic() + _REPAIR_S
        heard_all = False
        while not (heard_all or stop.received or time.monotonic() > deadline):
            heard = recorder.count
            _spin_for(executor, _QUIET_S)
            heard_all = recorder.count == heard and recorder.has(samples)


class _Answered:
    """Asks a node until an answer comes; an answer to a node that it has not met is lost."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._questions: list[Future] = []
        self._asked_at = -math.inf

    def __call__(self) -> bool:
        """Whether an answer has come; asks again after a while."""
        now = time.monotonic()
        if now > self._asked_at + _ASK_PERIOD_S and self._client.service_is_ready():
            self._asked_at = now
            self._questions.append(self._client.call_async(GetParameters.Request()))
        return any(question.done() for question in self._questions)


class _Progress:
    """Progress bar in simulated time, with event rate and real-time factor."""

    def __init__(self, duration_s: float, recorder: RunRecorder) -> None:
        self._recorder = recorder
        self._start_ns: int | None = None
        self._bar = tqdm(
            total=duration_s or None,
            unit='s',
            desc='simulated time',
            bar_format='{desc} {percentage:3.0f}% |{bar}| {n:.2f}/{total:.2f} s [{postfix}]',
            file=sys.stderr,
            disable=None,
        )

    def __enter__(self) -> _Progress:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave the finished bar on the screen."""
        self._bar.close()

    def update(self) -> None:
        """Show how far the loop is."""
        commands = self._recorder.messages[topics.COMMAND]
        if not commands:
            return
        stamp_ns = parse_command(commands[-1]).stamp_ns
        if self._start_ns is None:
            self._start_ns = parse_command(commands[0]).stamp_ns
        simulated_s = (stamp_ns - self._start_ns) * 1e-9
        wall_s = max(self._recorder.wall_seconds, 1e-9)
        self._bar.set_postfix_str(
            f'{len(commands) / wall_s:.0f} cycles/s, {self._recorder.event_count / wall_s:.0f} '
            f'events/s, {simulated_s / wall_s:.2f} x real time',
            refresh=False,
        )
        self._bar.n = simulated_s
        self._bar.refresh()


def _spin_for(executor: EventsExecutor, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while (remaining := deadline - time.monotonic()) > 0:
        executor.spin_once(timeout_sec=remaining)


def run_scenario(
    parameter_file: Path,
    output: Path,
    *,
    parameters: Mapping[str, object] | None = None,
    namespace: str = '',
    elsewhere: Collection[str] = (),
    composed: bool = False,
) -> LoopRun:
    """Run a scenario and write bag, result and figure into `output`.

    Parameters
    ----------
    parameter_file
        The scenario.
    output
        Folder for the results of this scenario; a former run's results in it are replaced.
    parameters
        Values that differ from the file.
    namespace
        Namespace of the whole loop; empty for none.
    elsewhere
        Nodes that are started by somebody else, as on another machine.
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
    scenario = load_scenario(parameter_file).replace(**parameters)
    plans = loop_plan(
        scenario,
        parameter_file,
        namespace=namespace,
        parameters=parameters,
        elsewhere=elsewhere,
        composed=composed,
        plant_waits=True,
    )
    design = design_from_scenario(scenario)
    output.mkdir(parents=True, exist_ok=True)
    bag_path = output / 'bag'
    if bag_path.exists():
        shutil.rmtree(bag_path)
    for name in _OF_A_RUN:
        (output / name).unlink(missing_ok=True)
    stop = StopSignal()
    runner = LoopRunner(scenario, plans)
    with BagWriter(bag_path, {topic: STREAMS[topic].type_name for topic in RECORDED}) as bag:
        bag.keep_scenario(scenario, parameter_file.stem)
        recorder = runner.run(bag, stop)
    if stop.received and not recorder.messages[topics.COMMAND]:
        raise InterruptedEarly
    bounds = None
    try:
        trace = decode_trace(recorder.messages)
    except IncompleteTraceError as error:
        # A run that was cut off may lack the last answer to a sample; any other must be whole.
        recorded = examine(read_bag(bag_path)) if stop.received else None
        if recorded is None or recorded.trace is None:
            raise LoopError(f'the recording is incomplete: {error}') from None
        trace = recorded.trace
        bounds = None if recorded.from_start else scenario.model_reference_bounds
    verdict = judge(
        trace,
        scenario,
        name=parameter_file.stem,
        h_star=design.figures.h_star,
        wall_seconds=recorder.wall_seconds,
        interrupted=stop.received,
        bounds=bounds,
    )
    verdict.save(output / 'result.json')
    save_figure(trace, scenario, verdict, output / 'figure.png')
    return LoopRun(trace=trace, verdict=verdict)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='closed_loop',
        description='Run a scenario as three ROS 2 nodes, record and judge it. The exit code is '
        '0 if the run regulated and the sector bound held (or was ended by Ctrl-C), 1 if not, and '
        '2 if a parameter or argument is wrong.',
    )
    parser.add_argument('--params-file', type=Path, required=True, help='scenario (YAML)')
    parser.add_argument('--output', type=Path, default=Path('out'), help='folder of the results')
    parser.add_argument('--duration', type=float, help="simulated seconds, instead of the file's")
    parser.add_argument('--namespace', default='', help='namespace of the whole loop')
    parser.add_argument('--mode', help="lockstep or realtime, instead of the file's")
    parser.add_argument('--method', help="synthesis method, instead of the file's")
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
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        run = run_scenario(
            options.params_file,
            output,
            parameters=given(duration=options.duration, mode=options.mode, method=options.method),
            namespace=options.namespace,
            elsewhere=options.elsewhere,
            composed=options.composed,
        )
    except SuiteError as error:
        print(f'closed_loop: {error}', file=sys.stderr)
        return error.exit_code
    except InterruptedEarly:
        print('interrupted before the first command')
        return 0
    finally:
        rclpy.try_shutdown()
    print(run.verdict)
    print(f'  results              {output}/  (bag, result.json, figure.png)')
    return 0 if run.verdict.passed or run.verdict.interrupted else 1
