"""Measure the controller's throughput: packets as bytes in, commands out, intervals kept."""

from __future__ import annotations

import time

import numpy as np
from bench_rounds import figure

from dvs_common.wire.events import EventPacket, make_events, pack_events, parse_events
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.paper.published import scenario

_ROUNDS, _SIDE, _PERIOD_NS = 5, 64, 1_000_000


def random_packets(width: int, height: int, events: int, count: int) -> list[bytes]:
    """Packets whose events take every pixel up and down in turn.

    Parameters
    ----------
    width
        Columns.
    height
        Rows.
    events
        Events a packet.
    count
        Number of packets.
    """
    rng = np.random.default_rng(0)
    pixel_count = width * height
    level = np.zeros(pixel_count, np.int64)
    messages = []
    for number in range(count):
        pixels = rng.integers(0, pixel_count, events)
        order = np.argsort(pixels, kind='stable')
        rank = np.empty(events, np.int64)
        sorted_pixels = pixels[order]
        starts = np.flatnonzero(np.r_[True, sorted_pixels[1:] != sorted_pixels[:-1]])
        sizes = np.diff(np.r_[starts, events])
        rank[order] = np.arange(events) - np.repeat(starts, sizes)
        up = (rank + level[pixels]) % 2 == 0
        level = (level + np.bincount(pixels, minlength=pixel_count)) % 2
        stamp_ns = (number + 1) * _PERIOD_NS
        records = make_events(
            times_ns=stamp_ns - np.sort(rng.integers(0, _PERIOD_NS, events))[::-1],
            pixels=pixels,
            polarities=np.where(up, 1, -1).astype(np.int8),
            signs=np.ones(events, np.int8),
            width=width,
            stamp_ns=stamp_ns,
            first_index=number * events,
        )
        messages.append(pack_events(EventPacket(stamp_ns=stamp_ns, events=records)))
    return messages


def _mev(events: int, count: int) -> float:
    offsets = np.random.default_rng(1).uniform(-0.01, 0.01, (_SIDE * _SIDE, 2))
    plain = scenario('mirror', _SIDE * _SIDE, offsets=offsets).replace(
        pixel_grid=(_SIDE, _SIDE), threshold_uncertainty=(), event_threshold=0.001
    )
    controller = event_controller(design_from_scenario(plain), plain)
    messages = random_packets(_SIDE, _SIDE, events, count)
    controller.take(parse_events(messages[0]))
    began = time.process_time()
    for message in messages[1:]:
        controller.take(parse_events(message))
        _ = controller.command
    return events * (count - 1) / (time.process_time() - began) * 1e-6


def measure(quick: bool = False) -> dict[str, float]:
    """Million events per CPU second in packets of 100,000 and of 1,000, 64 x 64 pixels.

    Parameters
    ----------
    quick
        One round.
    """
    rounds = 1 if quick else _ROUNDS
    figures = {
        **figure('controller_mev_100k', [_mev(100_000, 12) for _ in range(rounds)]),
        **figure('controller_mev_1k', [_mev(1_000, 400) for _ in range(rounds)]),
    }
    for name, value in figures.items():
        print(f'  {name} = {value:.4g}')
    return figures
