"""Measure the time from `closed_loop` to the first command, and what importing a core takes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time

from bench_loop import ROOT
from bench_rounds import figure

_ROUNDS = 5
_CORES = (
    'dvs_plant_sim.plant',
    'dvs_event_camera.event_camera',
    'dvs_hinf_controller.running.event_controller',
    'dvs_simulation',
)


def _first_command_s(domain: int) -> float:
    """Wall time from the start of scripts/run.sh to the end of a run of one period."""
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    nodes = [
        subprocess.Popen(
            [
                str(ROOT / 'scripts' / 'run.sh'),
                package,
                executable,
                *('--ros-args', '--params-file', str(ROOT / 'config' / 'mirror_r9.yaml')),
                *('-p', 'duration:=0.001'),
            ],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for package, executable in (
            ('dvs_event_camera', 'event_camera'),
            ('dvs_hinf_controller', 'hinf_controller'),
            ('dvs_plant_sim', 'plant_sim'),
        )
    ]
    try:
        for line in nodes[-1].stdout or ():
            if re.search(r'cycles/s', line):
                return time.perf_counter()
        raise RuntimeError('plant_sim ended without a run')
    finally:
        for node in nodes:
            node.terminate()
        for node in nodes:
            node.communicate()


def _import_s(module: str) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, '-c', f'import {module}'], check=True)
    whole = time.perf_counter() - began
    began = time.perf_counter()
    subprocess.run([sys.executable, '-c', 'pass'], check=True)
    return whole - (time.perf_counter() - began)


def measure(quick: bool = False) -> dict[str, float]:
    """Start the loop, and import every core in a process of its own.

    Parameters
    ----------
    quick
        One round.
    """
    rounds = range(1 if quick else _ROUNDS)
    starts = []
    for turn in rounds:
        began = time.perf_counter()
        starts.append(_first_command_s(60 + turn) - began)
    figures = figure('start_to_first_command_s', starts)
    for module in _CORES:
        name = f'import_{module.split(".")[0]}_s'
        figures |= figure(name, [_import_s(module) for _ in rounds])
    for name, value in figures.items():
        print(f'  {name} = {value:.3g}')
    return figures
