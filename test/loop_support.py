"""Real nodes as real processes, and a listener that keeps the bytes of their streams."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import JointState, PointCloud2

from dvs_common.node.middleware_periods import shorten_periods
from dvs_common.wire import topics

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'config'
# Without an end, and slow enough to leave the processors to others while a test waits.
UNHURRIED = {'duration': 0.0, 'real_time_factor': 0.25}
PACKAGE = {
    'plant_sim': 'dvs_plant_sim',
    'pendulum_sim': 'dvs_plant_sim',
    'event_camera': 'dvs_event_camera',
    'packet_bridge': 'dvs_event_camera',
    'scene': 'dvs_event_camera',
    'hinf_controller': 'dvs_hinf_controller',
    'closed_loop': 'dvs_closed_loop',
    'composed_loop': 'dvs_closed_loop',
    'dvs_closed_loop': 'dvs_closed_loop',
}


def program(executable: str) -> str:
    package = PACKAGE[executable]
    return f'{get_package_prefix(package)}/lib/{package}/{executable}'


def environment(domain: int) -> dict[str, str]:
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


def ros_arguments(parameters: dict[str, object] | None = None, file: Path | None = None) -> list:
    arguments = ['--ros-args']
    if file is not None:
        arguments += ['--params-file', str(file)]
    for name, value in (parameters or {}).items():
        arguments += ['-p', f'{name}:={value}']
    return arguments


def scenario_file(path: Path, **changes: object) -> Path:
    """The scenario `mirror_r3` with other values."""
    document = yaml.safe_load((CONFIG / 'mirror_r3.yaml').read_text())
    document['/**']['ros__parameters'].update(changes)
    path.write_text(yaml.safe_dump(document))
    return path


def start(
    executable: str, domain: int, arguments: list[str] | None = None, **variables: str
) -> subprocess.Popen:
    return subprocess.Popen(
        [program(executable), *(arguments or [])],
        env=environment(domain) | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def stop(process: subprocess.Popen, number: int = signal.SIGINT) -> tuple[int, str]:
    """Send a signal; return exit code and output; fail if the process does not react."""
    _signal(process, number)
    return _ended(process, number)


def stop_all(processes: list[subprocess.Popen]) -> list[str]:
    """Send Ctrl-C to all at once; return what each has written when it has ended in order."""
    for process in processes:
        _signal(process, signal.SIGINT)
    outputs = []
    for process in processes:
        code, output = _ended(process, signal.SIGINT)
        assert code == 0, output
        assert 'Traceback' not in output, output
        outputs.append(output)
    return outputs


def _signal(process: subprocess.Popen, number: int) -> None:
    if process.poll() is None:
        process.send_signal(number)


def _ended(process: subprocess.Popen, number: int) -> tuple[int, str]:
    try:
        output, _ = process.communicate(timeout=20)
    except subprocess.TimeoutExpired:
        process.kill()
        output, _ = process.communicate()
        raise AssertionError(f'ignored signal {number}: {output}') from None
    return process.returncode, output


def wait_for(
    condition: Callable[[], bool], timeout_s: float = 30.0, pause_s: float = 0.02
) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(pause_s)
    return False


def run_closed_loop(
    scenario: str | Path, domain: int, output: Path, *options: str, timeout_s: float = 120
) -> subprocess.CompletedProcess:
    file = scenario if isinstance(scenario, Path) else CONFIG / f'{scenario}.yaml'
    return subprocess.run(
        [program('closed_loop'), '--params-file', str(file), '--output', str(output), *options],
        env=environment(domain),
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )


class Visitor:
    """A node in a domain of the test's choice."""

    def __init__(self, domain: int) -> None:
        # Nodes that start later meet this one soon.
        shorten_periods()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, args=[])
        self.node = rclpy.create_node('listener', context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)

    @cached_property
    def streams(self) -> dict[str, list[bytes]]:
        """Serialized messages of `events` and `command`, from the first use of this on."""
        streams: dict[str, list[bytes]] = {topics.EVENTS: [], topics.COMMAND: []}
        for topic, kind in ((topics.EVENTS, PointCloud2), (topics.COMMAND, JointState)):
            qos = topics.handshake_qos('lockstep', topics.LISTENER_DEPTH)
            self.node.create_subscription(kind, topic, streams[topic].append, qos, raw=True)
        return streams

    def spin_until(self, condition: Callable[[], bool], timeout_s: float = 40.0) -> bool:
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if condition():
                return True
            self._executor.spin_once(timeout_sec=0.05)
        return condition()

    def close(self) -> None:
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


class Listener(Visitor):
    """Keeps the serialized messages of `events` and `command` from its beginning on."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        assert self.streams


@contextmanager
def listening(domain: int) -> Iterator[Listener]:
    listener = Listener(domain)
    try:
        yield listener
    finally:
        listener.close()


class Operator(Visitor):
    """Does what `ros2 lifecycle`, `ros2 param` and `ros2 topic echo` do."""

    def call(self, kind: type, service: str, request: object) -> object:
        self._meet(service.rpartition('/')[0])
        client = self.node.create_client(kind, service)
        assert self.spin_until(client.service_is_ready), f'no service {service}'
        future = client.call_async(request)
        assert self.spin_until(future.done), f'{service} does not answer'
        self.node.destroy_client(client)
        return future.result()

    def _meet(self, node: str) -> None:
        """Ask until an answer comes: that to a caller whom the node has not met yet is lost."""
        client = self.node.create_client(GetParameters, f'{node}/get_parameters')
        assert self.spin_until(client.service_is_ready), f'no node {node}'
        questions: list = []

        def is_met() -> bool:
            questions.append(client.call_async(GetParameters.Request()))
            return self.spin_until(lambda: any(q.done() for q in questions), timeout_s=1.0)

        assert self.spin_until(is_met), f'{node} does not answer'
        self.node.destroy_client(client)

    def transition(self, node: str, label: str) -> bool:
        request = ChangeState.Request(transition=Transition(label=label))
        return self.call(ChangeState, f'{node}/change_state', request).success

    def lifecycle_state(self, node: str) -> str:
        return self.call(GetState, f'{node}/get_state', GetState.Request()).current_state.label

    def set_parameters(self, node: str, **values: object) -> SetParametersResult:
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        return self.call(
            SetParametersAtomically, f'{node}/set_parameters_atomically', request
        ).result

    def parameter(self, node: str, name: str) -> object:
        request = GetParameters.Request(names=[name])
        answer = self.call(GetParameters, f'{node}/get_parameters', request)
        return parameter_value_to_python(answer.values[0])

    def collect(self, kind: type, topic: str, qos: object = 10) -> list:
        """List that grows with the messages of a topic."""
        received: list = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def forget(self, *received: list) -> None:
        """Empty these lists when the messages that still wait have come, too."""
        self.spin_until(lambda: False, timeout_s=0.3)
        for messages in received:
            messages.clear()


@contextmanager
def operating(domain: int) -> Iterator[Operator]:
    operator = Operator(domain)
    try:
        yield operator
    finally:
        operator.close()
