"""Measure the lockstep loop from 1 to 1280 x 720 pixels, and several loops side by side."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from bench_loop import ONE_PROCESS, ROOT, THREE_PROCESSES, loop_rate

_SIZES = ((1, 1), (8, 8), (64, 64), (346, 260), (1280, 720))
_SECONDS, _TICKS = 4.0, os.sysconf('SC_CLK_TCK')
# Until a loop runs.
_SETTLING_S = 4.0


def _cpu_and_memory(process: subprocess.Popen[str]) -> tuple[float, float]:
    """CPU seconds so far and resident megabytes of a process."""
    stat = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    pages = int(Path(f'/proc/{process.pid}/statm').read_text().split()[1])
    return (
        (int(stat[11]) + int(stat[12])) / _TICKS,
        pages * resource.getpagesize() / 1e6,
    )


def _run(
    size: tuple[int, int], domain: int, programs: tuple[tuple[str, str], ...], seconds: float
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
        'pixel_offsets:=[]',
        f'pixel_grid:=[{height}, {width}]',
        f'pixel_pitch:=[{span}, 0.0, 0.0, {span}]',
    ):
        arguments += ['-p', value]
    nodes = {
        executable: subprocess.Popen(
            [f'{get_package_prefix(package)}/lib/{package}/{executable}', *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for package, executable in programs
    }
    try:
        time.sleep(_SETTLING_S)
        before = {name: _cpu_and_memory(node) for name, node in nodes.items()}
        time.sleep(seconds)
        after = {name: _cpu_and_memory(node) for name, node in nodes.items()}
        plant = list(nodes.values())[-1]
        plant.send_signal(signal.SIGINT)
        output, _ = plant.communicate(timeout=30)
    finally:
        for node in nodes.values():
            node.terminate()
        for node in list(nodes.values())[:-1]:
            node.communicate()
    found = re.search(r'([0-9.]+) cycles/s', output)
    if found is None:
        raise RuntimeError(f'the plant made no cycle: {output[-500:]}')
    rate = float(found[1])
    return rate, {
        name: (1e3 * (after[name][0] - before[name][0]) / (rate * seconds), after[name][1])
        for name in nodes
    }


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
        One size.
    """
    figures: dict[str, float] = {}
    seconds = 1.0 if quick else _SECONDS
    for label, programs in (('three', THREE_PROCESSES), ('composed', ONE_PROCESS)):
        for size in _SIZES[:1] if quick else _SIZES:
            rate, nodes = _run(size, 90, programs, seconds)
            name = f'{size[0]}x{size[1]}_{label}'
            figures[f'scale_cycles_per_s_{name}'] = rate
            parts = '; '.join(
                f'{node} {milliseconds:.2f} ms of CPU a cycle, {megabytes:.0f} MB'
                for node, (milliseconds, megabytes) in nodes.items()
            )
            print(f'  {name}: {rate:.0f} cycles/s; {parts}', flush=True)
    loops = range(1, 2 if quick else (os.cpu_count() or 1) + 1)
    for count in loops:
        figures[f'scale_side_by_side_{count}'] = side_by_side(count, 1.0 if quick else 4.0)
        total = figures[f'scale_side_by_side_{count}']
        print(f'  {count} loops side by side: {total:.0f} cycles/s in all')
    return figures
