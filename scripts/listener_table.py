#!/usr/bin/env python3
"""What listeners of several depths miss of a running loop while their process does not run.

Each row is an `examples/listener.py` beside plant, camera and controller in lockstep at 100 or
1000 samples a second, or as fast as they go.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LISTENER = ROOT / 'examples' / 'listener.py'
NODES = (
    ('dvs_event_camera', 'event_camera'),
    ('dvs_hinf_controller', 'hinf_controller'),
    ('dvs_plant_sim', 'plant_sim'),
)
# Samples a second of the wall clock: sampling period, s, and pace.
RATES = {'100 Hz': (0.01, 1.0), '1 kHz': (0.001, 1.0), 'as fast as it goes': (0.001, 0.0)}
# Seconds away, and depth.
LISTENERS = ((0.1, 10), (0.1, 100), (1.0, 10), (1.0, 100), (1.0, 1000))
NUMBERS = re.compile(r': (\d+) packets, (\d+) events in .*, (\d+) missed')


def start(*command: object) -> subprocess.Popen[str]:
    """Start a program in our domain."""
    return subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def missed(period_s: float, pace: float, seconds: float) -> list[str]:
    """Cells of a table: packets a second, and the share of the events that each one missed."""
    values: dict[str, object] = {
        'duration': 0.0,
        'sampling_period': period_s,
        'real_time_factor': pace,
    }
    # A light that never rests, so that most packets have events.
    values |= {'event_threshold': 0.01, 'input_disturbance': 1.0}
    values |= {'nonphysical_luminosity': 'clamp'}
    parameters = [part for name, value in values.items() for part in ('-p', f'{name}:={value}')]
    listeners = [
        start(sys.executable, LISTENER, '--depth', depth, '--away', away, '--seconds', seconds)
        for away, depth in LISTENERS
    ]
    run = ROOT / 'scripts' / 'run.sh'
    nodes = [start(run, *node, '--ros-args', *parameters) for node in NODES]
    try:
        found = [NUMBERS.search(listener.communicate()[0]) for listener in listeners]
    finally:
        for node in nodes:
            node.send_signal(signal.SIGINT)
        for node in nodes:
            node.communicate()
    counts = [tuple(map(int, match.groups())) if match else (0, 0, 0) for match in found]
    shares = [f'{100 * lost / max(events + lost, 1):.1f} %' for _, events, lost in counts]
    # That of who misses nothing.
    return [f'{counts[-1][0] / seconds:.0f}', *shares]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=12.0, help='for which to listen (12)')
    parser.add_argument('--rates', nargs='+', choices=RATES, default=list(RATES))
    options = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    heads = [f'away {away:g} s, depth {depth}' for away, depth in LISTENERS]
    print(f'| wanted rate | packets/s received | {" | ".join(heads)} |')
    print('|' + '---|' * (len(heads) + 2))
    for name in options.rates:
        print(f'| {name} | {" | ".join(missed(*RATES[name], options.seconds))} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
