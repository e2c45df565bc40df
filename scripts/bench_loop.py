"""Measure the lockstep loop against the fastest trivial ring that rclpy offers.

Both run as three processes over Fast DDS, in turns, within one run: the ratio of their cycle rates
says what the loop costs beyond the middleware. The ring passes nine doubles around with rclpy's
EventsExecutor and its message objects.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import statistics
import subprocess
import time
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Barrier
from pathlib import Path

from ament_index_python.packages import get_package_prefix

ROOT = Path(__file__).resolve().parents[1]
ROUNDS = 5
RING_SECONDS = 4.0
LOOP_SECONDS = 6.0


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
    """Cycles per second of the trivial ring."""
    context = multiprocessing.get_context('spawn')
    rates: Queue[float] = context.Queue()
    matched = context.Barrier(3)
    nodes = [
        context.Process(target=_ring_node, args=(i, domain, matched, rates, seconds))
        for i in range(3)
    ]
    for node in nodes:
        node.start()
    measured = [rates.get(timeout=60) for _ in nodes]
    for node in nodes:
        node.join(timeout=10)
    return statistics.median(measured)


def loop_rate(domain: int, seconds: float) -> float:
    """Cycles per second of the lockstep loop at r = 9."""
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    arguments = ['--ros-args', '--params-file', str(ROOT / 'config' / 'mirror_r9.yaml')]
    arguments += ['-p', f'duration:={seconds}']
    programs = (
        ('dvs_event_camera', 'event_camera'),
        ('dvs_hinf_controller', 'hinf_controller'),
        ('dvs_plant_sim', 'plant_sim'),
    )
    nodes = [
        subprocess.Popen(
            [f'{get_package_prefix(package)}/lib/{package}/{executable}', *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for package, executable in programs
    ]
    try:
        output, _ = nodes[-1].communicate(timeout=120)
    finally:
        for node in nodes:
            node.terminate()
        for node in nodes[:-1]:
            node.communicate()
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
    share = 0.1 if quick else 1.0
    ratios = []
    for turn in range(1 if quick else ROUNDS):
        ring = ring_rate(30 + 2 * turn, share * RING_SECONDS)
        loop = loop_rate(31 + 2 * turn, share * LOOP_SECONDS)
        ratios.append(loop / ring)
        print(
            f'  round {turn + 1}: trivial ring {ring:.0f}, lockstep loop {loop:.0f} cycles/s, '
            f'ratio {ratios[-1]:.2f}'
        )
    ratio = statistics.median(ratios)
    print(f'lockstep_vs_ring = {ratio:.2f} (wanted: >= 0.70)')
    return {'lockstep_vs_ring': ratio}
