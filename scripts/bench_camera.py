#!/usr/bin/env python3
"""Speed of the event camera on one core: all modes, dense and sparse scene, sorted stamps.

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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_peers import openeb_updater, v2e_updater

from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import pack_events
from dvs_common.wire.messages import pack_image
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.streams.image_source import parse_luminosity

THRESHOLD = 0.15
PERIOD_NS = 1_000_000
# Pixels by which the pattern drifts from frame to frame.
DENSE, SPARSE = 0.4, 0.04
Frames = list[np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Peers:
    """Clones of other simulators; None for what is not raced."""

    v2e: Path | None = None
    openeb: Path | None = None


MODES: dict[str, dict[str, Any]] = {
    'hermite': {'interpolation': 'hermite'},
    'threshold mismatch': {'imperfections': Imperfections(threshold_mismatch=0.03)},
    'refractory period': {'imperfections': Imperfections(refractory_period=1e-4)},
    'shot noise': {'imperfections': Imperfections(shot_noise_rate=5.0)},
    'physical reset': {'imperfections': Imperfections(reset='level')},
    'leak': {'imperfections': Imperfections(leak_rate=0.1)},
    'low-pass': {'imperfections': Imperfections(cutoff_frequency=200.0)},
    'latency and jitter': {'imperfections': Imperfections(latency=1e-4, jitter=1e-5)},
    'all, with labels': {
        'imperfections': Imperfections(
            threshold_mismatch=0.03,
            refractory_period=1e-4,
            shot_noise_rate=5.0,
            leak_rate=0.1,
            cutoff_frequency=200.0,
            hot_pixel_fraction=1e-3,
            dead_pixel_fraction=1e-3,
            jitter=1e-5,
        ),
        'label_noise': True,
    },
}


def drifting_pattern(height: int, width: int, count: int, drift: float) -> Frames:
    """Two crossed gratings that drift by `drift` pixels a frame; luminosity 0.2 to 5."""
    x, y = np.arange(width), np.arange(height)[:, None]
    phase = 2 * np.pi / 40
    frames = []
    for k in range(count):
        first = np.sin(phase * (x + 0.3 * y - drift * k))
        second = np.sin(phase * (y - 0.4 * x + drift * k))
        frame = np.exp(first + 0.6 * second)
        # As those of messages are: a read-only frame is kept, not copied.
        frame.setflags(write=False)
        frames.append(frame)
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


def started_pixels(first: np.ndarray, **mode: Any) -> PixelArray:
    """Pixels in the midst of an epoch: references anywhere within a threshold of the light."""
    light = first.reshape(-1).astype(np.float64)
    bounds = ReferenceBounds(
        lower=light * np.exp(-0.99 * THRESHOLD), upper=light * np.exp(0.99 * THRESHOLD)
    )
    pixels = PixelArray(
        event_threshold=THRESHOLD, bounds=bounds, initial_reference='random', **mode
    )
    pixels.update(0, first)
    return pixels


def core_updater(first: np.ndarray, **mode: Any) -> Callable[[int, np.ndarray], int]:
    """Update function of a pixel array that returns the number of events."""
    array = started_pixels(first, **mode)
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


Timer = Callable[[], float]


class Race:
    """Contestants that take turns; the best time of each counts."""

    def __init__(self, frames: Sequence[Any], clock: Timer = time.process_time) -> None:
        self._frames, self._clock = frames, clock
        self.seconds: dict[str, float] = {}
        self.events: dict[str, float] = {}

    def run(
        self, name: str, update: Callable[[int, Any], int], frames: Sequence[Any] = ()
    ) -> None:
        """Seconds and events a frame, after one frame to warm up."""
        frames = frames or self._frames
        update(PERIOD_NS, frames[1])
        begin = self._clock()
        found = sum(update(k * PERIOD_NS, frames[k]) for k in range(2, len(frames)))
        spent = (self._clock() - begin) / (len(frames) - 2)
        self.seconds[name] = min(spent, self.seconds.get(name, np.inf))
        self.events[name] = found / (len(frames) - 2)

    def speed(self, name: str) -> float:
        """Million events a second."""
        return self.events[name] / self.seconds[name] / 1e6

    def show(self) -> None:
        """Print a line for each contestant."""
        for name, seconds in self.seconds.items():
            rate = f'{self.speed(name):8.2f} Mev/s' if self.events[name] > 1 else ''
            print(f'  {name:28s}{seconds * 1e3:9.3f} ms a frame {rate}')


def race_modes(frames: Frames, rounds: int, peers: Peers) -> Race:
    """All modes of ours, the reference and what there is of others."""
    race = Race(frames)
    messages = [pack_image(k * PERIOD_NS, frame, '64FC1') for k, frame in enumerate(frames)]
    for _ in range(rounds):
        first = frames[0]
        race.run('ideal', core_updater(first, backend='numba'))
        race.run('message to message', message_updater(first), messages)
        for name, mode in MODES.items():
            race.run(name, core_updater(first, backend='numba', **mode))
        race.run('ideal in NumPy', core_updater(first, backend='numpy'))
        race.run('straightforward NumPy', straightforward_updater(first))
        if peers.openeb is not None:
            for name, in_order in (("OpenEB's kernel", False), ('OpenEB, in order', True)):
                openeb = openeb_updater(peers.openeb, first, THRESHOLD, in_order=in_order)
                race.run(name, openeb)
        if peers.v2e is not None:
            for kind in ('clean', 'noisy'):
                race.run(f'v2e, {kind}', v2e_updater(peers.v2e, first, THRESHOLD, kind))
    return race


def race_silent(frame: np.ndarray, count: int, rounds: int) -> dict[str, float]:
    """Frames without an event, as floats and as 8 bits, over one read of two frames of floats.

    Returns
    -------
    dict
        Of the pass over the frame: time over that of the inner product of two frames; and of
        8-bit frames: speed over that of the same frames as floats.
    """
    grey = np.clip(np.rint(frame * 50), 1, 255)
    race = Race([grey] * count)
    octets, reference = grey.astype(np.uint8), np.ones(grey.size)
    for array in (grey, octets):
        array.setflags(write=False)
    for _ in range(rounds):
        race.run('silent, floats', core_updater(grey, backend='numba'))
        race.run('silent, 8 bits', core_updater(octets, backend='numba'), [octets] * count)
        race.run('read two frames', lambda _, y: int(np.einsum('i,i->', y.ravel(), reference) < 0))
    race.show()
    seconds = race.seconds
    return {
        'pass': seconds['silent, floats'] / seconds['read two frames'],
        'octets': seconds['silent, floats'] / seconds['silent, 8 bits'],
    }


def shared_work(work: Callable[[slice], None], rows: int, threads: int) -> Callable[..., int]:
    """Update function that lets threads share the rows of a frame."""
    pool = ThreadPoolExecutor(threads)
    parts = [slice(rows * k // threads, rows * (k + 1) // threads) for k in range(threads)]

    def update(*_: object) -> int:
        list(pool.map(work, parts))
        return 0

    return update


def race_threads(frames: Frames, rounds: int) -> dict[str, float]:
    """Wall time with one thread over that with two: of our pixels, and of what limits them.

    Copying a frame is bound by memory, exponentials of numbers in the first-level cache by the
    cores alone.
    """
    race = Race(frames, time.perf_counter)
    height, target = len(frames[0]), np.empty_like(frames[0])
    numbers = np.ones((2, 1024))

    def copied(rows: slice) -> None:
        np.copyto(target[rows], frames[0][rows])

    def computed(rows: slice) -> None:
        for row in range(rows.start, rows.stop):
            for _ in range(4):
                np.exp(frames[0][0, :1024], out=numbers[2 * row // height])

    for _ in range(rounds):
        for threads in (1, 2):
            update = core_updater(frames[0], backend='numba', threads=threads)
            race.run(f'threads: {threads}', update)
            race.run(f'copy, threads: {threads}', shared_work(copied, height, threads))
            race.run(f'compute, threads: {threads}', shared_work(computed, height, threads))
    race.show()
    return {
        name: race.seconds[f'{kind}threads: 1'] / race.seconds[f'{kind}threads: 2']
        for name, kind in (
            ('camera_two_threads', ''),
            ('camera_two_threads_copy', 'copy, '),
            ('camera_two_threads_compute', 'compute, '),
        )
    }


def measure(quick: bool = False, peers: Peers | None = None) -> dict[str, float]:
    """Measure, print tables and return the keys of scripts/bench.sh.

    Parameters
    ----------
    quick
        Fewer frames.
    peers
        Others to race beside ours; none by default.
    """
    sizes = {
        '346': (260, 346, 4 if quick else 200),
        '720p': (720, 1280, 3 if quick else 30),
    }
    rounds = 1 if quick else 3
    print(
        f'event camera, {datetime.date.today()}, {platform.processor() or platform.machine()}, '
        f'Python {platform.python_version()}, NumPy {np.__version__}; one core, CPU seconds'
    )
    peers = peers or Peers()
    result: dict[str, float] = {}
    ratios, overheads = [], []
    for size, (height, width, count) in sizes.items():
        for scene, drift in (('dense', DENSE), ('sparse', SPARSE)):
            frames = drifting_pattern(height, width, count, drift)
            race = race_modes(frames, rounds, peers)
            print(
                f'\n{width} x {height}, {scene}: {drift} pixels a frame, {count} frames, '
                f'{race.events["ideal"]:.0f} events a frame'
            )
            race.show()
            result[f'camera_mev_{size}_{scene}'] = race.speed('ideal')
            if scene == 'dense':
                result[f'camera_mev_{size}_hermite'] = race.speed('hermite')
                result[f'camera_mev_{size}_noisy'] = race.speed('all, with labels')
                ratios.append(race.seconds['straightforward NumPy'] / race.seconds['ideal'])
                overheads.append(race.seconds['message to message'] / race.seconds['ideal'])
    print('\n1280 x 720, frames without events')
    silent = race_silent(frames[0], 4 if quick else 60, rounds)
    print('\n1280 x 720, dense, wall seconds')
    threads = race_threads(drifting_pattern(720, 1280, sizes['720p'][2], DENSE), rounds)
    result |= threads | {
        'camera_vs_numpy': min(ratios),
        'camera_message_overhead': max(overheads),
        'camera_frame_pass': silent['pass'],
        'camera_8_bit': silent['octets'],
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
    parser.add_argument('--v2e', type=Path, metavar='FOLDER', help='clone of SensorsINI/v2e')
    parser.add_argument(
        '--openeb', type=Path, metavar='FOLDER', help='clone of prophesee-ai/openeb'
    )
    options = parser.parse_args()
    result = measure(options.quick, Peers(v2e=options.v2e, openeb=options.openeb))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()
