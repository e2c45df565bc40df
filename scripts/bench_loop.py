"""Measure the lockstep loop against the fastest trivial ring that rclpy offers.

Both run over Fast DDS, in turns, within one run, as three processes and as three nodes of one: the
ratio of their cycle rates shows what the loop costs beyond the middleware. The ring passes nine
doubles around with rclpy's EventsExecutor and its message objects.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import statistics
import subprocess
import time
from collections.abc import Callable, Sequence
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Barrier
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from bench_rounds import figure

ROOT = Path(__file__).resolve().parents[1]
ROUNDS = 5
# Wall-clock time of a turn of the ring, and simulated time of a turn of the loop: three processes
# make some 3 simulated seconds in one, one process 20. Turns of the two take as long, since what
# is not the loop (its first cycles, timers, other jobs) must weigh the same in both.
RING_SECONDS = 3.0
LOOP_SECONDS = 9.0
COMPOSED_SECONDS = 60.0


def _ring_node(
    number: int, domain: int, matched: Barrier, rates: Queue[float], seconds: float
) -> None:
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    import array

    import rclpy
    from rclpy.experimental import EventsExecutor
    from std_msgs.msg import Float64MultiArray

    rclpy.init()
    node = rclpy.create_node(f'ring_{number}')
    publisher = node.create_publisher(Float64MultiArray, f'ring_{(number + 1) % 3}', 10)
    message = Float64MultiArray(data=array.array('d', range(9)))
    count = 0

    def pass_on(_: Float64MultiArray) -> None:
        nonlocal count
        count += 1
        publisher.publish(message)

    node.create_subscription(Float64MultiArray, f'ring_{number}', pass_on, 10)
    executor = EventsExecutor()
    executor.add_node(node)
    while not publisher.get_subscription_count() or not node.count_publishers(f'ring_{number}'):
        executor.spin_once(timeout_sec=0.05)
    # The token must not be sent before every reader is matched.
    matched.wait(timeout=60)
    if number == 0:
        publisher.publish(message)
    start = time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        executor.spin_once(timeout_sec=0.1)
    rates.put(count / elapsed)
    executor.shutdown()
    rclpy.try_shutdown()


def ring_rate(domain: int, seconds: float) -> float:
    """Cycles per second of the trivial ring of three processes."""
    context = multiprocessing.get_context('spawn')
    rates: Queue[float] = context.Queue()
    matched = context.Barrier(3)
    nodes = [
        context.Process(target=_ring_node, args=(i, domain, matched, rates, seconds), daemon=True)
        for i in range(3)
    ]
    for node in nodes:
        node.start()
    measured = [rates.get(timeout=60) for _ in nodes]
    for node in nodes:
        node.join(timeout=10)
    return statistics.median(measured)


def _composed_ring(domain: int, rates: Queue[float], seconds: float) -> None:
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    import array

    import rclpy
    from rclpy.experimental import EventsExecutor
    from std_msgs.msg import Float64MultiArray

    rclpy.init()
    nodes = [rclpy.create_node(f'ring_{number}') for number in range(3)]
    message = Float64MultiArray(data=array.array('d', range(9)))
    publishers = [
        node.create_publisher(Float64MultiArray, f'ring_{(number + 1) % 3}', 10)
        for number, node in enumerate(nodes)
    ]
    hops = 0

    def passing(number: int) -> Callable[[Float64MultiArray], None]:
        def pass_on(_: Float64MultiArray) -> None:
            nonlocal hops
            hops += 1
            publishers[number].publish(message)

        return pass_on

    executor = EventsExecutor()
    for number, node in enumerate(nodes):
        node.create_subscription(Float64MultiArray, f'ring_{number}', passing(number), 10)
        executor.add_node(node)
    while not all(publisher.get_subscription_count() for publisher in publishers):
        executor.spin_once(timeout_sec=0.05)
    publishers[0].publish(message)
    start = time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        executor.spin_once(timeout_sec=0.1)
    rates.put(hops / 3 / elapsed)
    executor.shutdown()
    rclpy.try_shutdown()


def composed_ring_rate(domain: int, seconds: float) -> float:
    """Cycles per second of the trivial ring of three nodes in one process."""
    context = multiprocessing.get_context('spawn')
    rates: Queue[float] = context.Queue()
    ring = context.Process(target=_composed_ring, args=(domain, rates, seconds), daemon=True)
    ring.start()
    rate = rates.get(timeout=60)
    ring.join(timeout=10)
    return rate


THREE_PROCESSES = (
    ('dvs_event_camera', 'event_camera'),
    ('dvs_hinf_controller', 'hinf_controller'),
    ('dvs_plant_sim', 'plant_sim'),
)
ONE_PROCESS = (('dvs_closed_loop', 'composed_loop'),)


def loop_output(
    domain: int, seconds: float, programs: Sequence[tuple[str, str]], *parameters: str
) -> str:
    """What the plant of a loop at r = 9 has printed when its run is over.

    Parameters
    ----------
    domain
        ROS domain.
    seconds
        Simulated time.
    programs
        Package and executable of every process, the plant's last.
    *parameters
        ``name:=value``, for all nodes.
    """
    commands = [
        [f'{get_package_prefix(package)}/lib/{package}/{executable}']
        for package, executable in programs
    ]
    return output_of(commands, domain, seconds, *parameters)


def output_of(commands: Sequence[list[str]], domain: int, seconds: float, *parameters: str) -> str:
    """What the last of several commands, which make a loop, has printed when it ends.

    Parameters
    ----------
    commands
        Programs with their first arguments.
    domain
        ROS domain.
    seconds
        Simulated time.
    *parameters
        ``name:=value``, for all nodes.
    """
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    arguments = ['--ros-args', '--params-file', str(ROOT / 'config' / 'mirror_r9.yaml')]
    for parameter in (f'duration:={seconds}', *parameters):
        arguments += ['-p', parameter]
    nodes = [
        subprocess.Popen(
            [*command, *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for command in commands
    ]
    try:
        output, _ = nodes[-1].communicate(timeout=120)
    finally:
        for node in nodes:
            node.terminate()
        for node in nodes[:-1]:
            node.communicate()
    return output


def loop_rate(domain: int, seconds: float, programs: Sequence[tuple[str, str]]) -> float:
    """Cycles per second of the lockstep loop at r = 9; see `loop_output`."""
    return cycle_rate(loop_output(domain, seconds, programs))


def cycle_rate(output: str) -> float:
    """Cycles per second that a plant has printed at the end of its run."""
    found = re.search(r'([0-9.]+) cycles/s', output)
    if found is None:
        raise RuntimeError(f'plant_sim did not finish its run: {output}')
    return float(found[1])


def measure(quick: bool = False) -> dict[str, float]:
    """Run the benchmark; return its figures by name.

    Parameters
    ----------
    quick
        One short round.
    """
    share = 0.03 if quick else 1.0
    figures: dict[str, float] = {}
    for name, ring_of, programs, seconds, wanted in (
        ('lockstep_vs_ring', ring_rate, THREE_PROCESSES, LOOP_SECONDS, 0.90),
        ('composed_vs_ring', composed_ring_rate, ONE_PROCESS, COMPOSED_SECONDS, 0.75),
    ):
        ratios = []
        for turn in range(1 if quick else ROUNDS):
            ring = ring_of(30 + 2 * turn, share * RING_SECONDS)
            loop = loop_rate(31 + 2 * turn, share * seconds, programs)
            ratios.append(loop / ring)
            print(
                f'  round {turn + 1}: trivial ring {ring:.0f}, lockstep loop {loop:.0f} cycles/s, '
                f'ratio {ratios[-1]:.2f}'
            )
        figures |= figure(name, ratios)
        print(f'{name} = {figures[name]:.2f} (wanted: >= {wanted:.2f})')
    return figures
