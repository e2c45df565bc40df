"""Measure what an event costs camera and controller, from a thousand to a million pixels.

In process, CPU time: dense frames (0.4 pixels a frame) as messages into the camera, and packets of
ten thousand events into the controller, which keeps intervals.
"""

from __future__ import annotations

import math
import time

import numpy as np
from bench_camera import DENSE, core_updater, drifting_pattern
from bench_controller import random_packets

from dvs_common.wire.events import parse_events
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.paper.published import scenario

SIZES = ((32, 32), (100, 100), (346, 260), (1280, 720))
_EVENTS, _PIXELS_A_RUN, _PERIOD_NS = 10_000, 12_000_000, 1_000_000


def camera_us(width: int, height: int, rounds: int) -> float:
    """CPU microseconds an event of the pixels, frames of floats in and events in order out."""
    count = max(6, min(200, _PIXELS_A_RUN // (width * height)))
    frames = drifting_pattern(height, width, count, DENSE)
    best = math.inf
    for _ in range(rounds):
        update = core_updater(frames[0])
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


def measure(quick: bool = False) -> dict[str, float]:
    """CPU microseconds an event by size, and the dearest over the cheapest.

    Parameters
    ----------
    quick
        The two smallest sizes, once.
    """
    figures: dict[str, float] = {}
    rounds = 1 if quick else 3
    for part, cost_us in (('camera', camera_us), ('controller', controller_us)):
        costs = []
        for width, height in SIZES[:2] if quick else SIZES:
            costs.append(cost_us(width, height, rounds))
            figures[f'events_{part}_us_{width}x{height}'] = costs[-1]
        figures[f'events_{part}_ratio'] = max(costs) / min(costs)
    for name, value in figures.items():
        print(f'  {name} = {value:.3g}')
    return figures
