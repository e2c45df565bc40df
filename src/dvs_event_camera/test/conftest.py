"""A graph of real processes over real DDS, each test in a domain of its own; a recording."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest
from recording_files import EDGES, raw_file
from sensor_encoders import evt2_words, some_events

_PATIENCE_S = 30.0
_STUB = (
    'import sys, types\n'
    'from std_msgs.msg import String\n'
    'module = types.ModuleType("event_camera_msgs.msg")\n'
    'module.EventPacket = String\n'
    'sys.modules["event_camera_msgs"] = types.ModuleType("event_camera_msgs")\n'
    'sys.modules["event_camera_msgs.msg"] = module\n'
)


class Process:
    """An executable of this package in a process of its own."""

    def __init__(self, module, arguments, environment, *, stub=False):
        code = (
            _STUB if stub else 'import sys\n'
        ) + f'from dvs_event_camera.{module} import main\nsys.exit(main())\n'
        self._process = subprocess.Popen(
            [sys.executable, '-c', code, *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait(self):
        """Exit code, stdout and stderr when it ends by itself."""
        out, err = self._process.communicate(timeout=_PATIENCE_S)
        return self._process.returncode, out, err

    def has_ended(self):
        return self._process.poll() is not None

    def stop(self, number=signal.SIGINT):
        """Exit code, stdout and stderr after a signal."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        return self.wait()

    def kill(self):
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


class Graph:
    """Processes in one domain and a node of the test that talks to them."""

    def __init__(self, domain):
        rclpy = pytest.importorskip('rclpy')
        self._domain = domain
        self._processes = []
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node('observer', context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def start(self, module, *arguments, stub=False, **parameters):
        """Start an executable with ROS parameters."""
        command = list(arguments)
        if parameters:
            command.append('--ros-args')
            for name, value in parameters.items():
                command += ['-p', f'{name}:={value}']
        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(self._domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': os.pathsep.join(path for path in sys.path if path),
        }
        environment.setdefault('AMENT_PREFIX_PATH', sys.prefix)
        process = Process(module, command, environment, stub=stub)
        self._processes.append(process)
        return process

    def collect(self, message_type, topic, qos, *, raw=True):
        """Messages of a topic, in a list that grows while the graph turns."""
        received = []
        self.node.create_subscription(message_type, topic, received.append, qos, raw=raw)
        return received

    def turn_until(self, condition, *, act=lambda: None):
        """Let messages come in, calling `act` now and then, until `condition` holds."""
        end = time.monotonic() + _PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError('the graph did not get there')
            act()
            self._executor.spin_once(timeout_sec=0.02)

    def turn_for(self, seconds):
        """Let messages come in for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def close(self):
        for process in self._processes:
            process.kill()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def graph(domain):
    """Graph in a domain of its own."""
    with contextlib.closing(Graph(domain)) as made:
        yield made


@pytest.fixture
def events():
    return some_events(3000, width=640, height=480)


@pytest.fixture
def raw(events, tmp_path):
    """A recording with triggers in whole microseconds."""
    words = evt2_words(events, EDGES)
    return raw_file(tmp_path / 'in.raw', '% evt 2.0\n% geometry 640x480\n% end\n', words)
