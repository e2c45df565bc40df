"""Measure the exact automaton beside scipy's solve_ivp with event functions, in one run.

CPU seconds on one core, set-up included, best of a few; that both find the same events is checked.
Prints the figures, and with --json merges them into a file under the keys `exact_vs_dop853_r1`,
`exact_vs_dop853_r9`, `exact_vs_rk45_r100` and `exact_us_per_event_r10000`.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from scipy.integrate import solve_ivp

from dvs_common.scenario.model import PixelScene
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.exact.modes import _cached_form
from dvs_simulation.paper.published import PIXEL_OFFSETS, scenario
from dvs_simulation.sweep.random_loops import lqg_controller

_THRESHOLD = 0.05
_RTOL = 1e-9
_TWIN = 1e-12


def bench_loop(pixels: int) -> ClosedLoop:
    """Mirror image of the paper's example with `pixels` pixels under LQG."""
    plain = scenario('mirror', 1, event_threshold=_THRESHOLD)
    loop = ClosedLoop.from_scenario(plain, lqg_controller(plain.model, 0.01, 0.01))
    offsets = PIXEL_OFFSETS[:pixels]
    if pixels > len(offsets):
        offsets = np.random.default_rng(0).uniform(-0.01, 0.01, (pixels, 2))
    scene = PixelScene.from_offsets(loop.model, offsets, height=1, width=pixels)
    luminosity = scene.luminosity(loop.model, loop.initial_state)
    return replace(
        loop,
        scene=scene,
        bounds=ReferenceBounds.around(luminosity, 0.002),
        initial_reference=luminosity,
    )


def by_solve_ivp(loop: ClosedLoop, duration: float, method: str) -> list[tuple[float, int]]:
    """Events as (time, pixel) by restarting an integrator at every event.

    A strong rival: two event functions for the nearest thresholds, however many pixels there are.
    """
    n, k = loop.model.state_count, loop.controller.order
    a, b, c = loop.model.state_matrix, loop.model.input_matrix, loop.model.gradient
    controller = loop.controller
    system = np.block(
        [[a, b @ controller.output_matrix], [np.zeros((k, n)), controller.state_matrix]]
    )
    gain = np.concatenate([b @ controller.feedthrough, controller.input_vector])
    reference = loop.reference.copy()
    estimate = loop.sector().initial_estimate.copy()
    ratio = math.exp(loop.event_threshold)
    target = loop.set_point_luminosity().mean()
    base = float(c @ loop.equilibrium.state) + loop.scene.brightness_offsets
    state = np.concatenate([loop.initial_state - loop.equilibrium.state, np.zeros(k)])
    time_now, events = 0.0, []
    while time_now < duration:
        forcing = gain * (estimate.mean() - target)
        upper, lower = reference * ratio - base, reference / ratio - base
        functions = [_crossing(c, n, upper.min(), 1), _crossing(c, n, lower.max(), -1)]
        solution = solve_ivp(
            lambda t, x, f=forcing: system @ x + f,
            (time_now, duration),
            state,
            method=method,
            rtol=_RTOL,
            atol=1e-11,
            events=functions,
        )
        hits = [
            (float(found[0]), index) for index, found in enumerate(solution.t_events) if len(found)
        ]
        if not hits:
            break
        time_now, index = min(hits)
        state = solution.y_events[index][0]
        # Twins see the same: their roots would lie on the restart, which solve_ivp does not find.
        here = float(c @ state[:n])
        for i in np.flatnonzero(np.abs((lower if index else upper) - here) < _TWIN):
            polarity = -1 if index else 1
            reference[i] *= ratio**polarity
            estimate[i] *= ratio**polarity
            events.append((time_now, int(i)))
    return events


def _crossing(c: np.ndarray, n: int, level: float, sign: int) -> Callable[..., float]:
    def function(_t: float, x: np.ndarray) -> float:
        return float(c @ x[:n]) - level

    function.terminal = True  # type: ignore[attr-defined]
    function.direction = sign  # type: ignore[attr-defined]
    return function


def cpu_seconds(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Least CPU time of `repeats` calls, and the last result."""
    best, result = math.inf, None
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        best = min(best, time.process_time() - start)
    return best, result


def compare(pixels: int, method: str, duration: float, slow_duration: float) -> dict[str, float]:
    """CPU seconds per simulated second of both, after the events have been found equal."""
    loop = bench_loop(pixels)
    slow, reference = cpu_seconds(lambda: by_solve_ivp(loop, slow_duration, method), 1)

    def exact(seconds: float) -> Any:
        _cached_form.cache_clear()
        return simulate(loop, duration=seconds)

    fast, run = cpu_seconds(lambda: exact(duration), 5)
    once, _ = cpu_seconds(lambda: exact(slow_duration), 5)
    count = int(np.searchsorted(run.event_time, slow_duration, side='right'))
    times, order = np.array([event[0] for event in reference]), [event[1] for event in reference]
    if count != len(reference) or run.event_pixel[:count].tolist() != order:
        raise SystemExit(f'r = {pixels}: {method} and the exact automaton disagree on the events')
    worst = float(np.max(np.abs(times - run.event_time[:count]), initial=0.0))
    if worst > 1e-6:
        raise SystemExit(f'r = {pixels}: event times differ by {worst:.3g} s')
    return {
        'runs_a_second': 1 / once,
        'slow_runs_a_second': 1 / slow,
        'slow': slow / slow_duration,
        'fast': fast / duration,
        'events': count,
        'difference_s': worst,
    }


def us_per_event(pixels: int, duration: float, repeats: int) -> tuple[float, int]:
    """Microseconds of CPU an event, set-up included, and the number of events."""
    loop = bench_loop(pixels)
    simulate(loop, duration=1e-6)
    seconds, run = cpu_seconds(lambda: simulate(loop, duration=duration), repeats)
    return 1e6 * seconds / run.event_count, run.event_count


def measure(quick: bool = False) -> dict[str, float]:
    """All figures by their key.

    Parameters
    ----------
    quick
        Shorter runs of fewer pixels.
    """
    share = 0.1 if quick else 1.0
    figures: dict[str, float] = {}
    simulate(bench_loop(1), duration=0.1)  # compiles
    for key, pixels, method, duration, slow_duration in (
        ('exact_vs_dop853_r1', 1, 'DOP853', 60.0, 6.0),
        ('exact_vs_dop853_r9', 9, 'DOP853', 30.0, 2.0),
        ('exact_vs_rk45_r100', 100, 'RK45', 30.0, 0.3),
    ):
        result = compare(pixels, method, share * duration, share * slow_duration)
        figures[key] = result['slow'] / result['fast']
        if pixels == 9:
            figures['sweep_exact_runs_per_core_s'] = result['runs_a_second']
            figures['sweep_solve_ivp_runs_per_core_s'] = result['slow_runs_a_second']
        print(
            f'{key}: {figures[key]:.0f} x  ({method} {result["slow"]:.3g}, exact '
            f'{result["fast"]:.3g} CPU s a second; {result["events"]} equal events, times within '
            f'{result["difference_s"]:.1e} s)',
            flush=True,
        )
    figures['exact_us_per_event_r10000'], count = us_per_event(10_000, 3.0 * share, 3)
    print(
        f'exact_us_per_event_r10000: {figures["exact_us_per_event_r10000"]:.3f} us '
        f'({count} events)',
        flush=True,
    )
    if not quick:
        micro, count = us_per_event(921_600, 0.05, 1)
        print(f'921600 pixels (1280 x 720): {micro:.3f} us an event ({count} events)', flush=True)
    return figures


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; write them where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--json', type=Path, help='file to merge the figures into')
    options = parser.parse_args(arguments)
    print(f'python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}')
    figures = measure()
    if options.json:
        known = json.loads(options.json.read_text()) if options.json.exists() else {}
        options.json.write_text(json.dumps({**known, **figures}, indent=2) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
