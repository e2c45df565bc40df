"""Where the microseconds of a lockstep cycle go: by node and section, and by kind of message.

The nodes of a loop at r = 9 run as three processes that note when a message is handed over, when
the answer is given to the middleware, and when that returns. What no node has of a cycle is
delivery and the waking of the next process. Then, warm and in one process: what the middleware
and rclpy take for each kind of message, as bytes and as objects.
"""

from __future__ import annotations

import array
import gc
import importlib
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rclpy
from bench_loop import cycle_rate, output_of
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import Float64MultiArray

from dvs_common.node import direct_calls
from dvs_common.node.message_information import WithInformation
from dvs_common.wire.events import NO_EVENTS, EventPacket, pack_events
from dvs_common.wire.messages import Vector, pack_command, pack_image

# The plant's last: its output ends the run.
_NODES = {
    'camera': 'dvs_event_camera.event_camera_node',
    'controller': 'dvs_hinf_controller.hinf_controller_node',
    'plant': 'dvs_plant_sim.plant_sim_node',
}
_SECONDS = 6.0
_DOMAIN = 70


class Watch:
    """Notes the sections of a node's work on each message, ns."""

    def __init__(self) -> None:
        self.times: dict[str, list[int]] = {'before': [], 'publish': [], 'after': []}
        self._taken_ns: int | None = None
        self._published_ns = self._collected_ns = 0
        self.longest_collection_ns = 0

    def collect(self, phase: str, _: Any) -> None:
        """Note the longest garbage collection once the objects of the start are frozen.

        Parameters
        ----------
        phase
            `start` or `stop`, see `gc.callbacks`.
        """
        now_ns = time.perf_counter_ns()
        if phase == 'start':
            self._collected_ns = now_ns
        elif gc.get_freeze_count():
            spent_ns = now_ns - self._collected_ns
            self.longest_collection_ns = max(self.longest_collection_ns, spent_ns)

    def take(self, handle: Callable[..., None]) -> Callable[..., None]:
        """Callback of a subscription with its beginning and its end noted.

        Parameters
        ----------
        handle
            The callback.
        """

        def timed(*received: Any) -> None:
            self._taken_ns = time.perf_counter_ns()
            handle(*received)
            if self._taken_ns is None:
                self.times['after'].append(time.perf_counter_ns() - self._published_ns)
            self._taken_ns = None

        return timed

    def publish(self, send: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """The same of what publishes the answer.

        Parameters
        ----------
        send
            Takes CDR bytes.
        """

        def timed(message: bytes) -> None:
            began = time.perf_counter_ns()
            send(message)
            if self._taken_ns is not None:
                self._published_ns = time.perf_counter_ns()
                self.times['before'].append(began - self._taken_ns)
                self.times['publish'].append(self._published_ns - began)
                self._taken_ns = None

        return timed


def run_watched(module: str, output: Path) -> int:
    """Run a node and write the medians of its sections, and its longest collection, microseconds.

    Parameters
    ----------
    module
        Module of the node.
    output
        JSON file.
    """
    watch = Watch()
    sender = direct_calls.raw_sender
    direct_calls.raw_sender = lambda publisher: watch.publish(sender(publisher))
    WithInformation.__call__ = watch_method(  # type: ignore[method-assign]
        watch, WithInformation.__call__
    )
    gc.callbacks.append(watch.collect)
    code: int = importlib.import_module(module).main()
    medians = {
        section: 1e-3 * statistics.median(times[len(times) // 3 :])
        for section, times in watch.times.items()
    }
    medians['collection'] = 1e-3 * watch.longest_collection_ns
    output.write_text(json.dumps(medians), encoding='utf-8')
    return code


def watch_method(watch: Watch, method: Callable[..., None]) -> Callable[..., None]:
    """Method in place of another one, with its beginning and its end noted.

    Parameters
    ----------
    watch
        What notes them.
    method
        The other one.
    """
    timed = watch.take(method)
    return lambda own, *received: timed(own, *received)


def sections(seconds: float) -> dict[str, float]:
    """Microseconds of a cycle by node and section, and what is left of it.

    Parameters
    ----------
    seconds
        Simulated time.
    """
    figures: dict[str, float] = {}
    with TemporaryDirectory() as folder:
        files = {name: Path(folder) / f'{name}.json' for name in _NODES}
        commands = [
            [sys.executable, __file__, module, str(files[name])] for name, module in _NODES.items()
        ]
        cycle_us = 1e6 / cycle_rate(output_of(commands, _DOMAIN, seconds))
        for name, file in files.items():
            for section, microseconds in json.loads(file.read_text(encoding='utf-8')).items():
                figures[f'hop_{name}_{section}_us'] = microseconds
    inside = sum(us for name, us in figures.items() if '_before_' in name or '_publish_' in name)
    return {**figures, 'hop_delivery_us': (cycle_us - inside) / 3, 'hop_cycle_us': cycle_us}


def _messages() -> dict[str, tuple[type, bytes]]:
    command = Vector(stamp_ns=5, names=('u1',), values=np.ones(1))
    ring = Float64MultiArray(data=array.array('d', range(9)))
    return {
        'image': (Image, pack_image(5, np.ones((3, 3)), '64FC1')),
        'packet': (PointCloud2, pack_events(EventPacket(stamp_ns=5, events=NO_EVENTS))),
        'command': (JointState, pack_command(command)),
        'ring': (Float64MultiArray, serialize_message(ring)),
    }


def message_costs(
    node: Node, name: str, kind: type, message: bytes, count: int
) -> dict[str, float]:
    """Median microseconds of publishing and taking one kind of message, as bytes and as objects.

    Parameters
    ----------
    node
        Node of publisher and subscriptions.
    name
        Name of the kind.
    kind
        Class of the messages.
    message
        CDR bytes.
    count
        How often.
    """
    publisher = node.create_publisher(kind, f'hop_{name}', 10)
    readers = {
        way: node.create_subscription(kind, f'hop_{name}', print, 10, raw=way == 'bytes').handle
        for way in ('bytes', 'object')
    }
    while publisher.get_subscription_count() < len(readers):
        time.sleep(0.01)
    form = deserialize_message(message, kind)
    ways = {
        'publish_bytes': lambda: publisher.handle.publish_raw(message),
        'publish_object': lambda: publisher.publish(form),
    }
    times: dict[str, list[int]] = {}
    for _ in range(count):
        for way, publish in ways.items():
            times.setdefault(way, []).append(_spent(publish)[0])
            for taken, reader in readers.items():
                times.setdefault(f'take_{taken}', []).append(_take(reader, kind, taken))
    return {
        f'hop_{name}_{way}_us': 1e-3 * statistics.median(spent) for way, spent in times.items()
    }


def _spent(step: Callable[[], Any]) -> tuple[int, Any]:
    began = time.perf_counter_ns()
    found = step()
    return time.perf_counter_ns() - began, found


def _take(reader: Any, kind: type, way: str) -> int:
    """Time of the take that brings the message, ns."""
    while True:
        spent_ns, found = _spent(lambda: reader.take_message(kind, way == 'bytes'))
        if found is not None:
            return spent_ns


def measure(quick: bool = False) -> dict[str, float]:
    """All figures by their key.

    Parameters
    ----------
    quick
        Whether a short run does.
    """
    figures = sections(0.05 * _SECONDS if quick else _SECONDS)
    os.environ.update(ROS_DOMAIN_ID=str(_DOMAIN + 1), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    rclpy.init()
    node = rclpy.create_node('hop')
    for name, (kind, message) in _messages().items():
        figures |= message_costs(node, name, kind, message, 50 if quick else 1000)
    node.destroy_node()
    rclpy.try_shutdown()
    for key, value in figures.items():
        print(f'  {key} = {value:.1f}', flush=True)
    return figures


if __name__ == '__main__':
    module, output, *rest = sys.argv[1:]
    sys.argv = [module, *rest]
    sys.exit(run_watched(module, Path(output)))
