"""Measure the lockstep loop from 1 to 1280 x 720 pixels, and several loops side by side."""

from __future__ import annotations

import multiprocessing
import os
import resource
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.queues import Queue
from pathlib import Path
from queue import Empty

from ament_index_python.packages import get_package_prefix
from bench_loop import ONE_PROCESS, ROOT, THREE_PROCESSES, loop_rate

SIZES = ((1, 1), (8, 8), (64, 64), (346, 260), (1280, 720))
_SECONDS, _TICKS = 4.0, os.sysconf('SC_CLK_TCK')
# Longest time until a loop runs.
_PATIENCE_S = 40.0
# Cycles that a figure should rest on.
_LEAST_CYCLES = 30
_UNHURRIED = ('real_time_factor:=0.1',)


class TooSlowError(RuntimeError):
    """A loop that has not made the two cycles that are waited for.

    Parameters
    ----------
    seconds
        How long it was waited for them.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__(f'< {2 / seconds:.2g} cycles/s')
        self.bound = 2 / seconds


def _cpu_and_memory(process: subprocess.Popen[bytes]) -> tuple[float, float]:
    """CPU seconds so far and resident megabytes of a process."""
    stat = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    pages = int(Path(f'/proc/{process.pid}/statm').read_text().split()[1])
    return (
        (int(stat[11]) + int(stat[12])) / _TICKS,
        pages * resource.getpagesize() / 1e6,
    )


def _run(
    size: tuple[int, int],
    domain: int,
    programs: tuple[tuple[str, str], ...],
    seconds: float,
    *parameters: str,
) -> tuple[float, dict[str, tuple[float, float]]]:
    """Cycles per second, and of every process CPU milliseconds a cycle and megabytes."""
    width, height = size
    span = 0.02 / max(width, height)
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    arguments = ['--ros-args', '--params-file', str(ROOT / 'config' / 'mirror_r9.yaml')]
    for value in (
        'duration:=0.0',
        # The time of the others grows with the pixels.
        'method:=structured',
        'pixel_offsets:=[]',
        f'pixel_grid:=[{height}, {width}]',
        f'pixel_pitch:=[{span}, 0.0, 0.0, {span}]',
        *parameters,
    ):
        arguments += ['-p', value]
    nodes = {
        executable: subprocess.Popen(
            [f'{get_package_prefix(package)}/lib/{package}/{executable}', *arguments],
            env=environment,
            # A full pipe would stop them.
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for package, executable in programs
    }
    context = multiprocessing.get_context('spawn')
    rates: Queue[list[float]] = context.Queue()
    listener = context.Process(target=_collect_rates, args=(domain, rates, seconds), daemon=True)
    listener.start()
    try:
        if not rates.get(timeout=2 * _PATIENCE_S):
            raise TooSlowError(_PATIENCE_S)
        before = {name: _cpu_and_memory(node) for name, node in nodes.items()}
        began = time.perf_counter()
        found = rates.get(timeout=seconds + _PATIENCE_S)
        passed = time.perf_counter() - began
        after = {name: _cpu_and_memory(node) for name, node in nodes.items()}
    except Empty:
        raise TooSlowError(_PATIENCE_S) from None
    finally:
        listener.terminate()
        listener.join()
        for node in nodes.values():
            node.terminate()
        for node in nodes.values():
            node.wait()
    rate = sum(found) / len(found)
    if not rate:
        raise TooSlowError(seconds)
    return rate, {
        name: (1e3 * (after[name][0] - before[name][0]) / (rate * passed), after[name][1])
        for name in nodes
    }


def _collect_rates(domain: int, rates: Queue[list[float]], seconds: float) -> None:
    """First a rate that the plant reports on /diagnostics, then all those of a while.

    A subscriber there does not disturb the loop. An empty list where it makes no cycle.
    """
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray

    from dvs_common.node.session import ros_session

    found: list[float] = []

    def note(message: DiagnosticArray) -> None:
        found.extend(
            float(pair.value)
            for status in message.status
            for pair in status.values
            if pair.key == 'cycles/s'
        )

    with ros_session() as session:
        node = session.add(rclpy.create_node('listener'))
        node.create_subscription(DiagnosticArray, '/diagnostics', note, 10)
        end = time.perf_counter() + _PATIENCE_S
        # The first cycles load what was compiled; a quick run shows that it works.
        while len(found) < min(4, seconds) or not all(found[-2:]):
            if session.ended or time.perf_counter() > end:
                break
            session.turn()
        rates.put(list(filter(None, found[-2:])))
        found.clear()
        end = time.perf_counter() + seconds
        last = end + _PATIENCE_S / 2
        while (now := time.perf_counter()) < end or (now < last and sum(found) < _LEAST_CYCLES):
            if session.ended:
                break
            session.turn()
        rates.put(found or [0.0])


def side_by_side(count: int, seconds: float) -> float:
    """Cycles per second of several loops of three processes at once, all together."""
    with ThreadPoolExecutor(count) as pool:
        rates = pool.map(lambda i: loop_rate(70 + i, seconds, THREE_PROCESSES), range(count))
    return sum(rates)


def measure(quick: bool = False) -> dict[str, float]:
    """Print the table of scale; return cycles per second by size.

    Parameters
    ----------
    quick
        One size, whose loop does not take the whole machine.
    """
    figures: dict[str, float] = {}
    seconds, parameters = (0.1, _UNHURRIED) if quick else (_SECONDS, ())
    for label, programs in (('three', THREE_PROCESSES), ('composed', ONE_PROCESS)):
        for size in SIZES[:1] if quick else SIZES:
            name = f'{size[0]}x{size[1]}_{label}'
            try:
                rate, nodes = _run(size, 90, programs, seconds, *parameters)
            except TooSlowError as error:
                print(f'  {name}: {error}', flush=True)
                figures[f'scale_cycles_per_s_{name}_bound'] = error.bound
                continue
            figures[f'scale_cycles_per_s_{name}'] = rate
            for node, (milliseconds, megabytes) in nodes.items():
                figures[f'scale_{name}_ms_{node}'] = milliseconds
                figures[f'scale_{name}_mb_{node}'] = megabytes
            parts = '; '.join(
                f'{node} {milliseconds:.2f} ms of CPU a cycle, {megabytes:.0f} MB'
                for node, (milliseconds, megabytes) in nodes.items()
            )
            print(f'  {name}: {rate:.0f} cycles/s; {parts}', flush=True)
    loops = range(1, 2 if quick else (os.cpu_count() or 1) + 1)
    for count in loops:
        figures[f'scale_side_by_side_{count}'] = side_by_side(count, seconds)
        total = figures[f'scale_side_by_side_{count}']
        print(f'  {count} loops side by side: {total:.0f} cycles/s in all')
    return figures
