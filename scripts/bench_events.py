"""Measure what an event costs camera and controller, from a thousand to a million pixels.

In process, CPU time: frames of some thousand events and more into compiled pixels, and packets of
ten thousand events into the controller, which keeps intervals. Beside it what memory alone takes:
adding to one number in as many bytes a pixel as the controller keeps, at random.
"""

from __future__ import annotations

import math
import time

import numba
import numpy as np
from bench_camera import DENSE, core_updater, drifting_pattern
from bench_controller import random_packets

from dvs_common.wire.events import parse_events
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.paper.published import scenario

# Bytes that the controller reads and writes of a pixel at an event.
_RECORD = 32
# Pixels by which the pattern drifts from frame to frame where `DENSE` makes too few events.
_DRIFTS = {(32, 32): 4.0, (100, 100): 0.8}
SIZES = ((32, 32), (100, 100), (346, 260), (1280, 720))
_EVENTS, _PIXELS_A_RUN, _PERIOD_NS = 10_000, 12_000_000, 1_000_000


def camera_us(width: int, height: int, rounds: int) -> float:
    """CPU microseconds an event of the pixels, frames of floats in and events in order out."""
    count = max(6, min(200, _PIXELS_A_RUN // (width * height)))
    frames = drifting_pattern(height, width, count, _DRIFTS.get((width, height), DENSE))
    best = math.inf
    for _ in range(rounds):
        update = core_updater(frames[0], backend='numba')
        update(_PERIOD_NS, frames[1])
        began = time.process_time()
        events = sum(update(k * _PERIOD_NS, frames[k]) for k in range(2, count))
        best = min(best, (time.process_time() - began) / events)
    return 1e6 * best


def controller_us(width: int, height: int, rounds: int) -> float:
    """CPU microseconds an event of the controller, packets as bytes in and commands out."""
    offsets = np.random.default_rng(1).uniform(-0.01, 0.01, 2 * width * height)
    plain = scenario('mirror', 1, event_threshold=0.001).replace(
        pixel_grid=(height, width), pixel_offsets=tuple(offsets.tolist())
    )
    design = design_from_scenario(plain)
    messages = random_packets(width, height, _EVENTS, 20)
    best = math.inf
    for _ in range(rounds):
        controller = event_controller(design, plain)
        controller.take(parse_events(messages[0]))
        began = time.process_time()
        for message in messages[1:]:
            controller.take(parse_events(message))
            _ = controller.command
        best = min(best, time.process_time() - began)
    return 1e6 * best / (_EVENTS * (len(messages) - 1))


@numba.njit
def _touch(pixels: np.ndarray, numbers: np.ndarray) -> None:
    for pixel in pixels:
        numbers[pixel] += 1.0


def memory_us(width: int, height: int, rounds: int) -> float:
    """CPU microseconds of one number read and written, of a pixel at random."""
    pixels = np.random.default_rng(0).integers(0, width * height, 20 * _EVENTS)
    numbers = np.zeros((width * height, _RECORD // 8))[:, 0]
    _touch(pixels[:1], numbers)
    best = math.inf
    for _ in range(rounds):
        began = time.process_time()
        _touch(pixels, numbers)
        best = min(best, time.process_time() - began)
    return 1e6 * best / pixels.size


def measure(quick: bool = False) -> dict[str, float]:
    """CPU microseconds an event by size, and the dearest over the cheapest.

    Parameters
    ----------
    quick
        The two smallest sizes, once.
    """
    figures: dict[str, float] = {}
    sizes, rounds = (SIZES[:2], 1) if quick else (SIZES, 3)
    parts = (('camera', camera_us), ('controller', controller_us), ('memory', memory_us))
    costs = {}
    for part, cost_us in parts:
        costs[part] = np.array([cost_us(*size, rounds) for size in sizes])
        for (width, height), cost in zip(sizes, costs[part], strict=True):
            figures[f'events_{part}_us_{width}x{height}'] = float(cost)
        figures[f'events_{part}_ratio'] = float(costs[part].max() / costs[part].min())
    own = costs['controller'] - costs['memory']
    figures['events_controller_less_memory_ratio'] = float(own.max() / own.min())
    for name, value in figures.items():
        print(f'  {name} = {value:.3g}')
    return figures
