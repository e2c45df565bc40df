#!/usr/bin/env python3
"""What each shortcut of a cycle is worth: time without it over time with it.

The messages are those of a lockstep run of nine pixels. With and without take turns, and the best
of some rounds counts.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import String

from dvs_common.arrays import FloatArray
from dvs_common.scenario.loop_file import read_loop_values
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import NO_EVENTS, EventPacket, pack_events, parse_events
from dvs_common.wire.messages import (
    pack_command,
    pack_image,
    pack_state,
    parse_command,
    parse_image,
    parse_state,
)
from dvs_common.wire.stamped import Memo
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.sampled.sampled_loop import SampledRun, run_sampled

SCENARIO = Path(__file__).resolve().parents[1] / 'config' / 'mirror_r9.yaml'
_PERIOD_NS = 1_000_000


def ratio(without: Callable[[], Any], with_it: Callable[[], Any], rounds: int) -> float:
    """Least CPU time of the one over that of the other.

    Parameters
    ----------
    without
        The general path.
    with_it
        The shortcut.
    rounds
        How often each runs, in turns.
    """
    best = [math.inf, math.inf]
    for _ in range(rounds):
        for k, function in enumerate((without, with_it)):
            began = time.process_time()
            function()
            best[k] = min(best[k], time.process_time() - began)
    return best[0] / best[1]


def by_our_codec(run: SampledRun) -> None:
    """Every message of a run parsed to arrays, and packed again from them.

    Parameters
    ----------
    run
        The run.
    """
    for message in run.messages['luminosity']:
        frame = parse_image(message)
        pixels = np.frombuffer(frame.data, '<f8').reshape(frame.format.height, -1)
        pack_image(frame.stamp_ns, pixels, frame.format.encoding)
    for message in run.messages['events']:
        pack_events(parse_events(message))
    for message in run.messages['state']:
        pack_state(parse_state(message))
    for message in run.messages['command']:
        pack_command(parse_command(message))


def by_generated_classes(run: SampledRun) -> None:
    """The same with the classes that ROS generates.

    Parameters
    ----------
    run
        The run.
    """
    for topic, kind in (('luminosity', Image), ('events', PointCloud2)):
        for message in run.messages[topic]:
            found = deserialize_message(message, kind)
            found.data = np.frombuffer(found.data, np.uint8).tobytes()
            serialize_message(found)
    for topic, part in (('state', 'position'), ('command', 'effort')):
        for message in run.messages[topic]:
            joints = deserialize_message(message, JointState)
            setattr(joints, part, np.asarray(getattr(joints, part)).tolist())
            serialize_message(joints)


def parse_all(run: SampledRun) -> None:
    """Every message of a run parsed to arrays.

    Parameters
    ----------
    run
        The run.
    """
    for message in run.messages['luminosity']:
        parse_image(message)
    for message in run.messages['state']:
        parse_state(message)
    for message in run.messages['command']:
        parse_command(message)


def parse_all_anew(run: SampledRun) -> None:
    """The same, each message as if it were the first of its stream.

    Parameters
    ----------
    run
        The run.
    """
    with patch.object(Memo, 'find', lambda _memo, _message: None):
        parse_all(run)


def answers_us(scenario: Scenario, samples: int) -> tuple[float, float]:
    """Median microseconds from an empty packet to its command, without and with looking ahead.

    Parameters
    ----------
    scenario
        The loop.
    samples
        Number of packets.
    """
    design = design_from_scenario(scenario)
    plain, ahead = (event_controller(design, scenario) for _ in range(2))
    spent: tuple[list[int], list[int]] = ([], [])
    for k in range(samples):
        packet = EventPacket(stamp_ns=k * _PERIOD_NS, events=NO_EVENTS)
        for controller, times in zip((plain, ahead), spent, strict=True):
            began = time.perf_counter_ns()
            controller.take(packet)
            controller.command  # noqa: B018
            times.append(time.perf_counter_ns() - began)
        ahead.look_ahead()
    without, with_it = (1e-3 * statistics.median(times) for times in spent)
    return without, with_it


def frames(array: PixelArray, samples: list[FloatArray]) -> None:
    """Silent frames into an array of pixels.

    Parameters
    ----------
    array
        The pixels.
    samples
        Luminosities.
    """
    start = array.stamp_ns or 0
    for k, sample in enumerate(samples):
        array.update(start + k + 1, sample)


def silent_band_gain(rounds: int) -> float:
    """CPU time of silent frames of nine pixels without the silent band over that with it.

    Parameters
    ----------
    rounds
        How often each runs.
    """
    samples = [5.0 + 1e-6 * np.sin(np.arange(9) + k) for k in range(1000)]
    plain, quick = (PixelArray(event_threshold=0.1) for _ in range(2))
    for array in (plain, quick):
        array.update(0, samples[0])
    plain._band = None
    return ratio(lambda: frames(plain, samples), lambda: frames(quick, samples), rounds)


def generated_variants(message: bytes) -> int:
    """In how many ways the generated classes write one command, among other messages.

    Parameters
    ----------
    message
        The command.
    """
    command, rng = deserialize_message(message, JointState), np.random.default_rng(0)
    found = set()
    for _ in range(400):
        serialize_message(String(data=rng.bytes(int(rng.integers(1, 600))).hex()))
        found.add(serialize_message(command))
    return len(found)


def measure(quick: bool = False) -> dict[str, float]:
    """All figures by their key.

    Parameters
    ----------
    quick
        Whether a short run does.
    """
    values = {**read_loop_values(SCENARIO).merged(), 'duration': 0.05 if quick else 1.0}
    scenario = Scenario.from_values(values)
    run, rounds = run_sampled(scenario), 2 if quick else 15
    without, with_it = answers_us(scenario, 50 if quick else 3000)
    variants = generated_variants(run.messages['command'][0])
    figures = {
        'cycle_cdr_gain': ratio(
            lambda: by_generated_classes(run), lambda: by_our_codec(run), rounds
        ),
        'cycle_generated_variants': float(variants),
        'cycle_memo_gain': ratio(lambda: parse_all_anew(run), lambda: parse_all(run), rounds),
        'cycle_look_ahead_gain': without / with_it,
        'cycle_silent_band_gain': silent_band_gain(rounds),
    }
    for key, value in figures.items():
        print(f'{key}: {value:.2f}', flush=True)
    print(
        f'an empty packet is answered in {with_it:.1f} us, without looking ahead {without:.1f} us'
    )
    return figures


if __name__ == '__main__':
    measure()
