#!/usr/bin/env python3
"""Speed of the event camera on one core: ideal pixels, a drifting pattern, sorted int64-ns stamps.

Ratios are of CPU seconds measured in one run, the contestants taking turns, so that they hold on
a busy machine too.
"""

from __future__ import annotations

import argparse
import datetime
import json
import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import pack_events
from dvs_common.wire.messages import pack_image
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.streams.image_source import parse_luminosity

THRESHOLD = 0.15
PERIOD_NS = 1_000_000
_STILL, _ONE_PASS = 'frame without events', 'one pass (add two frames)'
Frames = list[np.ndarray]


def drifting_pattern(height: int, width: int, count: int) -> Frames:
    """Two crossed gratings that drift by 0.4 pixels a frame; luminosity 0.2 to 5."""
    x, y = np.arange(width), np.arange(height)[:, None]
    phase = 2 * np.pi / 40
    frames = []
    for k in range(count):
        first = np.sin(phase * (x + 0.3 * y - 0.4 * k))
        second = np.sin(phase * (y - 0.4 * x + 0.4 * k))
        frames.append(np.exp(first + 0.6 * second))
    return frames


class Straightforward:
    """The same pixel as one writes it down first: whole frames, one event of all pixels a round.

    "Core in NumPy" is the tuned variant: it leaves the frame after one pass and goes on with the
    pixels that fire.
    """

    def __init__(self, first: np.ndarray) -> None:
        self.previous = np.log(first)
        self.origin = self.previous.copy()
        self.counts = np.zeros(first.shape, np.int64)
        self.stamp_ns = 0

    def update(self, stamp_ns: int, frame: np.ndarray) -> tuple[np.ndarray, ...]:
        """Events of the interval as t, x, y, polarity, sorted by (t, y, x)."""
        level = np.log(frame)
        found = []
        while True:
            reference = self.origin + self.counts * THRESHOLD
            polarity = np.where(level - reference >= THRESHOLD, 1, 0)
            polarity = np.where(reference - level >= THRESHOLD, -1, polarity)
            y, x = np.nonzero(polarity)
            if not y.size:
                break
            with np.errstate(divide='ignore', invalid='ignore'):
                share = (reference + polarity * THRESHOLD - self.previous) / (
                    level - self.previous
                )
            t = self.stamp_ns + np.ceil(share[y, x] * (stamp_ns - self.stamp_ns)).astype(np.int64)
            found.append((t, x, y, polarity[y, x]))
            self.counts += polarity
        self.previous, self.stamp_ns = level, stamp_ns
        if not found:
            return (np.empty(0, np.int64),) * 4
        t, x, y, polarity = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.lexsort((x, y, t))
        return t[order], x[order], y[order], polarity[order]


def core_updater(backend: str, first: np.ndarray) -> Callable[[int, np.ndarray], int]:
    """Update function of a pixel array that returns the number of events."""
    array = PixelArray(event_threshold=THRESHOLD, backend=backend)
    array.update(0, first)
    return lambda stamp_ns, frame: len(array.update(stamp_ns, frame))


def straightforward_updater(first: np.ndarray) -> Callable[[int, np.ndarray], int]:
    """Update function of the NumPy reference."""
    reference = Straightforward(first)
    return lambda stamp_ns, frame: len(reference.update(stamp_ns, frame)[0])


def message_updater(first: np.ndarray) -> Callable[[int, bytes], int]:
    """Update function from a serialized Image to a serialized PointCloud2."""
    scenario = Scenario.from_values(
        {'event_threshold': THRESHOLD, 'reference_uncertainty': 0.0, 'mode': 'realtime'}
    )
    camera = EventCamera.of_scenario(scenario)
    camera.take(parse_luminosity(pack_image(0, first, '64FC1')))

    def update(stamp_ns: int, message: bytes) -> int:
        exposure = camera.take(parse_luminosity(message))
        assert exposure is not None
        return sum(len(pack_events(packet)) > 0 for packet in exposure.packets) and len(
            exposure.events
        )

    return update


def measure_size(height: int, width: int, count: int, rounds: int) -> dict[str, float]:
    """CPU seconds a frame of all contestants, and events a frame."""
    frames = drifting_pattern(height, width, count)
    messages = [pack_image(k * PERIOD_NS, frame, '64FC1') for k, frame in enumerate(frames)]
    target = np.empty_like(frames[0])
    best: dict[str, float] = {}

    def run(name: str, update: Callable[[int, Any], int], source: Sequence[Any]) -> int:
        update(PERIOD_NS, source[1])
        begin = time.process_time()
        found = sum(update(k * PERIOD_NS, source[k]) for k in range(2, count))
        spent = (time.process_time() - begin) / (count - 2)
        best[name] = min(spent, best.get(name, np.inf))
        return found

    for _ in range(rounds):
        first = frames[0]
        events = run('core', core_updater('numba', first), frames)
        run('core in NumPy', core_updater('numpy', first), frames)
        run('straightforward NumPy', straightforward_updater(first), frames)
        run('message to message', message_updater(first), messages)
        run(_STILL, core_updater('numba', first), [first] * count)
        run(_ONE_PASS, lambda _, frame: np.add(frame, frames[0], out=target).size, frames)
    return {'events': events / (count - 2), **best}


def measure(quick: bool = False) -> dict[str, float]:
    """Measure, print a table and return the keys of scripts/bench.sh.

    Parameters
    ----------
    quick
        Fewer frames.
    """
    sizes = {
        '346 x 260': (260, 346, 60 if quick else 300),
        '1280 x 720': (720, 1280, 12 if quick else 40),
    }
    print(
        f'event camera, {datetime.date.today()}, {platform.processor() or platform.machine()}, '
        f'Python {platform.python_version()}, NumPy {np.__version__}; one core, CPU seconds'
    )
    speed: dict[str, float] = {}
    ratios: list[float] = []
    overheads: list[float] = []
    for name, (height, width, count) in sizes.items():
        found = measure_size(height, width, count, rounds=2 if quick else 3)
        events = found.pop('events')
        print(f'\n{name}, {count} frames, {events:.0f} events a frame')
        for contestant, seconds in found.items():
            makes_events = contestant not in (_STILL, _ONE_PASS)
            rate = f'{events / seconds / 1e6:8.2f} Mev/s' if makes_events else ''
            print(f'  {contestant:28s}{seconds * 1e3:9.3f} ms a frame {rate}')
        speed[name] = events / found['core'] / 1e6
        ratios.append(found['straightforward NumPy'] / found['core'])
        overheads.append(found['message to message'] / found['core'])
    result = {
        'camera_mev_346': speed['346 x 260'],
        'camera_mev_720p': speed['1280 x 720'],
        'camera_vs_numpy': min(ratios),
        'camera_message_overhead': max(overheads),
    }
    print()
    for key, value in result.items():
        print(f'{key:28s}{value:8.2f}')
    return result


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='fewer frames')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures there')
    options = parser.parse_args()
    result = measure(options.quick)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()
