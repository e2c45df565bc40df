"""Measure sample to command in realtime at 1 kHz, beside a bare round trip of three hops.

An observer subscribes to all streams of the loop and notes when each message arrives; a sample's
stamp is the wall-clock instant at which it was due. The bare trip is a message of nine doubles
from a timer of 1 kHz through two other processes and back.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import time
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from queue import Empty

import numpy as np
from bench_loop import THREE_PROCESSES, loop_output
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds
from dvs_common.node.middleware_periods import shorten_periods
from dvs_common.wire.events import pack_events, parse_events
from dvs_common.wire.messages import Vector, pack_command
from dvs_common.wire.stamped import stamp_of
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.paper.published import scenario
from dvs_simulation.sampled.sampled_loop import run_by_messages

_SECONDS, _PERIOD_S, _ATTEMPTS = 8.0, 0.001, 3
_MEETING_S = 2.5
# Longest time until three processes have met.
_PATIENCE_S = 60.0
_LATE_COMMANDS = ('nonphysical_luminosity:=clamp', 'command_timeout:=9.0')
_PERCENTILES = {'p50': 50.0, 'p99': 99.0, 'p999': 99.9}


def _environment(domain: int) -> None:
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    # Nodes of the loop that start later meet this process soon.
    shorten_periods()


def _hop(number: int, domain: int, count: int, trips: Queue[list[float]], is_over: Event) -> None:
    _environment(domain)
    import array

    import rclpy
    from rclpy.experimental import EventsExecutor
    from std_msgs.msg import Float64MultiArray

    rclpy.init()
    node = rclpy.create_node(f'hop_{number}')
    publisher = node.create_publisher(Float64MultiArray, f'hop_{(number + 1) % 3}', 10)
    times: list[float] = []

    def pass_on(message: Float64MultiArray) -> None:
        if number:
            publisher.publish(message)
        else:
            times.append(time.perf_counter() - message.data[0])

    def begin() -> None:
        data = array.array('d', [time.perf_counter(), *range(8)])
        publisher.publish(Float64MultiArray(data=data))

    node.create_subscription(Float64MultiArray, f'hop_{number}', pass_on, 10)
    if number == 0:
        node.create_timer(_PERIOD_S, begin)
    gc.freeze()
    executor = EventsExecutor()
    executor.add_node(node)
    while len(times) < count and not is_over.is_set():
        executor.spin_once(timeout_sec=0.1)
    if number == 0:
        trips.put(times[len(times) // 4 :])
    executor.shutdown()
    rclpy.try_shutdown()


def bare_trips(domain: int, seconds: float) -> NDArray[np.float64]:
    """Times of bare round trips of three hops, s."""
    context = multiprocessing.get_context('spawn')
    trips: Queue[list[float]] = context.Queue()
    is_over = context.Event()
    count = round(seconds / _PERIOD_S)
    nodes = [
        context.Process(target=_hop, args=(i, domain, count, trips, is_over), daemon=True)
        for i in range(3)
    ]
    for node in nodes:
        node.start()
    try:
        return np.array(trips.get(timeout=seconds + _PATIENCE_S))
    except Empty:
        raise RuntimeError(f'fewer than {count} bare round trips came back') from None
    finally:
        is_over.set()
        for node in nodes:
            node.join(timeout=10)


def _observe(
    domain: int, arrivals: Queue[dict[str, dict[int, int]]], is_there: Event, is_over: Event
) -> None:
    _environment(domain)
    import rclpy
    from rclpy.experimental import EventsExecutor
    from sensor_msgs.msg import Image, JointState, PointCloud2

    from dvs_common.wire import topics

    rclpy.init()
    node = rclpy.create_node('observer')
    seen: dict[str, dict[int, int]] = {}

    def note(topic: str, message: bytes) -> None:
        seen[topic].setdefault(stamp_of(message), time.time_ns())

    kinds = (
        (Image, topics.LUMINOSITY),
        (PointCloud2, topics.EVENTS),
        (JointState, topics.COMMAND),
    )
    for kind, topic in kinds:
        seen[topic] = {}
        node.create_subscription(
            kind, topic, lambda message, topic=topic: note(topic, message), 100, raw=True
        )
    executor = EventsExecutor()
    executor.add_node(node)
    is_there.set()
    while not is_over.is_set():
        executor.spin_once(timeout_sec=0.1)
    arrivals.put(seen)
    executor.shutdown()
    rclpy.try_shutdown()


def _observed(
    domain: int, seconds: float, *parameters: str
) -> tuple[dict[str, dict[int, int]], str]:
    """When the messages of a run arrived, by topic and stamp, and what the plant printed."""
    context = multiprocessing.get_context('spawn')
    arrivals: Queue[dict[str, dict[int, int]]] = context.Queue()
    is_there, is_over = context.Event(), context.Event()
    observer = context.Process(
        target=_observe, args=(domain, arrivals, is_there, is_over), daemon=True
    )
    observer.start()
    try:
        is_there.wait(timeout=_PATIENCE_S)
        output = loop_output(domain, seconds, THREE_PROCESSES, 'mode:=realtime', *parameters)
    finally:
        is_over.set()
    seen = arrivals.get(timeout=30)
    observer.join(timeout=10)
    return seen, output


def loop_latencies(
    domain: int, seconds: float, *parameters: str
) -> dict[str, NDArray[np.float64]]:
    """Times from a sample's instant to its messages' arrival, s, by stage."""
    for _ in range(_ATTEMPTS):
        seen, output = _observed(domain, seconds, *parameters)
        stamps = sorted(set.intersection(*(set(arrivals) for arrivals in seen.values())))
        if stamps:
            break
        # On a busy machine the commands of a start come too late for an unstable plant.
        print(f'  once more: {output.strip().splitlines()[-1]}')
    else:
        raise RuntimeError('no sample of the realtime loop was answered')
    stamps = stamps[len(stamps) // 4 :]
    luminosity, events, command = seen['luminosity'], seen['events'], seen['command']
    table = np.array([[s, luminosity[s], events[s], command[s]] for s in stamps])
    differences = as_seconds(np.diff(table, axis=1))
    stages = ('plant_and_transport', 'camera_and_transport', 'controller_and_transport')
    return {
        'all': as_seconds(table[:, 3] - table[:, 0]),
        **{stage: differences[:, i] for i, stage in enumerate(stages)},
    }


def own_compute_us(seconds: float) -> dict[str, float]:
    """Median time of camera and controller from bytes to bytes at r = 9, warm, microseconds."""
    plain = scenario('mirror', 9).replace(duration=seconds)
    run = run_by_messages(plain)
    camera, controller = EventCamera.of_scenario(plain), event_controller(run.design, plain)
    eyes, brains = [], []
    for number, image in enumerate(run.messages['luminosity']):
        began = time.perf_counter()
        exposure = camera.take(parse_luminosity(image))
        assert exposure is not None
        packet = pack_events(exposure.packets[-1])
        eyes.append(time.perf_counter() - began)
        if number == 0:
            controller.take_keyframe(camera.keyframe())
        began = time.perf_counter()
        taken = parse_events(packet)
        controller.take(taken)
        pack_command(Vector(stamp_ns=taken.stamp_ns, names=('u1',), values=controller.command))
        brains.append(time.perf_counter() - began)
    return {
        'latency_camera_us': 1e6 * float(np.median(eyes)),
        'latency_controller_us': 1e6 * float(np.median(brains)),
        'latency_own_compute_us': 1e6 * float(np.median(np.add(eyes, brains))),
    }


def collection_ms() -> float:
    """Longest full garbage collection of a process like a node's after `gc.freeze`, ms."""
    gc.collect()
    gc.freeze()
    longest = 0.0
    for _ in range(5):
        began = time.perf_counter()
        gc.collect()
        longest = max(longest, time.perf_counter() - began)
    gc.unfreeze()
    return 1e3 * longest


def measure(quick: bool = False) -> dict[str, float]:
    """Run loop and ring; print the breakdown.

    Parameters
    ----------
    quick
        Shorter.
    """
    seconds = 0.5 if quick else _SECONDS
    figures = {**own_compute_us(seconds / 4), 'latency_collection_ms': collection_ms()}
    trips = bare_trips(80, seconds)
    # A quick run goes to its end, however late the commands of a busy machine come, and is no
    # shorter than its nodes may take to meet.
    sizes = {'': _LATE_COMMANDS} if quick else {'': (), '_64x64': _many_pixels()}
    for suffix, parameters in sizes.items():
        stages = loop_latencies(82, max(seconds, _MEETING_S), *parameters)
        for name, percent in _PERCENTILES.items():
            trip = float(np.percentile(trips, percent))
            whole = float(np.percentile(stages['all'], percent))
            figures[f'latency_{name}{suffix}_vs_ring'] = whole / trip
            parts = ', '.join(
                f'{stage} {1e6 * np.percentile(times, percent):.0f}'
                for stage, times in stages.items()
                if stage != 'all'
            )
            print(
                f'  {name}{suffix}: {1e6 * whole:.0f} us over {1e6 * trip:.0f} us bare; {parts} us'
            )
    for name, value in figures.items():
        print(f'  {name} = {value:.3g}')
    return figures


def _many_pixels() -> tuple[str, ...]:
    return (
        'method:=structured',
        'pixel_offsets:=[]',
        'pixel_grid:=[64, 64]',
        'pixel_pitch:=[0.0003, 0.0, 0.0, 0.0003]',
    )
