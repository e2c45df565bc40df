"""Starts the nodes of one scenario, receives their messages to the end and stops them."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from dvs_closed_loop.bags.recording import BagWriter
from dvs_closed_loop.running.loop_progress import LoopProgress
from dvs_closed_loop.running.processes import NodeProcess, ending
from dvs_closed_loop.running.run_recorder import RunRecorder
from dvs_common.errors import SuiteError
from dvs_common.node.node_plan import NodePlan
from dvs_common.node.session import RosSession
from dvs_common.scenario.parameters import CAMERA, CONTROLLER
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics

_START_TIMEOUT_S = 30.0
# After discovery in the graph, endpoints still need a moment to be matched on both sides.
_SETTLE_S = 0.3
# The run is complete when nothing more arrives for a while; what was lost on the way is
# sent again when the middleware next asks for it, by itself every 3 s.
_QUIET_S = 0.3
_REPAIR_S = 7.0
_ASK_PERIOD_S = 0.5
_TURN_S = 0.1
_LOOK_AROUND_S = 1.0
_DISCOVERY = (
    'ROS_AUTOMATIC_DISCOVERY_RANGE',
    'ROS_STATIC_PEERS',
    'ROS_LOCALHOST_ONLY',
    'ROS_DISCOVERY_SERVER',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
)
_ANOTHER_LOOP = (
    'a plant_sim runs in this ROS domain already: give another ROS_DOMAIN_ID, or a --namespace'
)


class LoopError(SuiteError):
    """A loop that could not start or broke off."""


def run_loop(
    scenario: Scenario,
    plans: Sequence[NodePlan],
    bag: BagWriter,
    session: RosSession,
    *,
    begin: Callable[[], None],
) -> RunRecorder:
    """Run a loop to its end or until a signal; its nodes are gone afterwards.

    Parameters
    ----------
    scenario
        Checked parameters.
    plans
        What to start; the plant is the last and waits to be activated.
    bag
        Where the messages go.
    session
        Turns what observes the loop; a signal ends the run early.
    begin
        Called when all nodes have met and the plant runs.

    Returns
    -------
    RunRecorder
        What was received.

    Raises
    ------
    LoopError
        If a node fails, or the nodes do not find each other in time.
    """
    loop = _RunningLoop(scenario, plans, bag, session)
    try:
        loop.start()
        if not session.stop.received:
            begin()
        loop.watch()
        return loop.recorder
    finally:
        loop.close()


class _RunningLoop:
    def __init__(
        self, scenario: Scenario, plans: Sequence[NodePlan], bag: BagWriter, session: RosSession
    ) -> None:
        self._scenario = scenario
        self._plans = plans
        self._session = session
        self._stop = session.stop
        self._processes: list[NodeProcess] = []
        self._node = session.add(_observer(plans[-1]))
        self._progress = LoopProgress(scenario.loop.duration)
        self.recorder = RunRecorder(self._node, scenario.loop.mode, bag)

    def start(self) -> None:
        """Start the nodes, and the plant when all have met."""
        self._require_alone()
        for plan in self._plans:
            self._processes.append(NodeProcess(plan))
        client = self._node.create_client(ChangeState, 'plant_sim/change_state')
        received = self.recorder.messages[topics.LUMINOSITY]
        self._wait(lambda: client.service_is_ready() or bool(received), 'plant_sim to answer')
        if not client.service_is_ready() and received:
            self.recorder.plant_waited = False
            self._wait(self.recorder.receives_all_but_states, 'camera and controller')
            self._look_for_states()
            return
        self._change_state(client, Transition.TRANSITION_CONFIGURE)
        self._wait(self.recorder.receives_every_node, 'all three nodes')
        self._meet_every_node()
        settled = time.monotonic() + _SETTLE_S
        self._wait(lambda: time.monotonic() > settled, 'discovery')
        self._change_state(client, Transition.TRANSITION_ACTIVATE)

    def _look_for_states(self) -> None:
        """Note whether the plant publishes its state: it did so beside the first luminosity."""
        deadline = time.monotonic() + _LOOK_AROUND_S
        while not self.recorder.receives(topics.STATE) and time.monotonic() < deadline:
            self._session.turn(0.05)
        self.recorder.publishes_states = self.recorder.receives(topics.STATE)

    def watch(self) -> None:
        """Receive the loop's messages to its end."""
        plant = self._processes[-1]
        while plant.exit_code is None and not self._stop.received:
            self._check(self._processes[:-1])
            self._receive_for(_TURN_S)
            if self._is_over_for_us():
                plant.stop()
                self._receive_the_end()
                return
        if plant.exit_code:
            raise LoopError(f'{plant.name} {ending(plant.exit_code)}')
        self._receive_the_end()

    def _is_over_for_us(self) -> bool:
        """Whether a plant without a duration of its own has run for so long."""
        duration = self._scenario.loop.duration
        return not self.recorder.plant_waited and 0 < duration <= self.recorder.answered_s

    def close(self) -> None:
        """Stop what runs."""
        self._progress.close()
        for process in reversed(self._processes):
            process.stop()

    def _require_alone(self) -> None:
        """Refuse to start beside a loop whose plant would receive our requests, and ours its."""
        client = self._node.create_client(ChangeState, 'plant_sim/change_state')
        deadline = time.monotonic() + _LOOK_AROUND_S
        while time.monotonic() < deadline and not self._stop.received:
            if client.service_is_ready():
                raise LoopError(_ANOTHER_LOOP)
            self._session.turn(0.05)
        self._node.destroy_client(client)

    def _meet_every_node(self) -> None:
        """Wait for an answer of every node: only one that has met us sends us its messages.

        The graph shows a node as soon as we have met it; that it has met us too may take seconds
        more, and in realtime mode what it publishes until then is lost to the recording.
        """
        started = {plan.executable for plan in self._plans}
        for name in sorted(started & {CAMERA, CONTROLLER}):
            client = self._node.create_client(GetParameters, f'{name}/get_parameters')
            self._wait(_Answered(client), f'{name} to answer')

    def _change_state(self, client: Client, transition: int) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        future = client.call_async(request)
        self._wait(future.done, 'plant_sim to change its state')
        if future.done() and not future.result().success:
            # On a busy machine we may meet another loop's plant only now.
            raise LoopError(
                f'plant_sim refused to start; its message is above, unless {_ANOTHER_LOOP}'
            )

    def _wait(self, condition: Callable[[], bool], awaited: str) -> None:
        deadline = time.monotonic() + _START_TIMEOUT_S
        while not condition() and not self._stop.received:
            if time.monotonic() > deadline:
                raise LoopError(f'waited {_START_TIMEOUT_S:g} s in vain for {awaited}{_set()}')
            self._check(self._processes)
            self._progress.waits_for(awaited)
            self._session.turn(0.05)

    def _check(self, processes: Sequence[NodeProcess]) -> None:
        for process in processes:
            if process.exit_code is not None:
                raise LoopError(f'{process.name} {ending(process.exit_code)}')

    def _receive_the_end(self) -> None:
        lockstep = self._scenario.loop.mode == 'lockstep'
        samples = self._scenario.sample_count + 1 if lockstep else 0
        deadline = time.monotonic() + _REPAIR_S
        received_all = False
        while not (received_all or self._stop.received or time.monotonic() > deadline):
            received = self.recorder.count
            self._receive_for(_QUIET_S)
            received_all = self.recorder.count == received and self.recorder.has(samples)

    def _receive_for(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while (remaining := deadline - time.monotonic()) > 0:
            self._session.turn(remaining)
        self._progress.update(self.recorder)


def _set() -> str:
    """What is set of discovery, for a loop whose nodes did not find each other."""
    found = [f'{name}={os.environ[name]}' for name in _DISCOVERY if os.environ.get(name)]
    return f'; discovery goes by {", ".join(found)}' if found else ''


def _observer(plan: NodePlan) -> Node:
    """Node beside the plant of `plan`, with its namespace and remappings."""
    remappings = [part for old, new in plan.remappings for part in ('-r', f'{old}:={new}')]
    arguments = ['--ros-args', *remappings] if remappings else []
    return Node('closed_loop', namespace=plan.namespace or None, cli_args=arguments)


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
