"""Compile what is compiled, once, so that no first run is slow: setup.sh does it.

Numba keeps compiled kernels on disk by the types of their arguments. This runs a little of each:
camera, codecs, controller, design, exact and sampled loop.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bench_codecs

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import EVENT_DTYPE, EventPacket
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.rehearsal import rehearse
from dvs_event_camera.streams.event_records import records_of
from dvs_hinf_controller.design.design import Design, design_controller
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.paper.published import scenario
from dvs_simulation.sampled.sampled_loop import run_sampled
from dvs_simulation.sweep.promise import run_promise_task

_PIXELS, _FRAMES = 4096, 3
_MANY_PIXELS = {
    'pixel_offsets': (),
    'pixel_grid': (64, 64),
    'pixel_pitch': (0.0003, 0.0, 0.0, 0.0003),
}


def _frames(dtype: str) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(1, 255, _PIXELS).astype(dtype) for _ in range(_FRAMES)]


def _designed(asked: Scenario) -> Design:
    """A design that is found now, and not one that was kept."""
    return design_controller(DesignProblem.from_scenario(asked), method=asked.controller.method)


def compile_camera() -> None:
    """Kernels of the pixels, for the types of pictures and kinds of pixels."""
    noisy = Imperfections(threshold_mismatch=0.03, shot_noise_rate=5.0, leak_rate=1.0, jitter=1e-4)
    kinds = (('linear_log', Imperfections()), ('hermite', Imperfections()), ('linear_log', noisy))
    for interpolation, imperfections in kinds:
        for dtype in ('u1', 'u2', 'f4', 'f8'):
            pixels = PixelArray(
                event_threshold=0.15,
                interpolation=interpolation,
                imperfections=imperfections,
                label_noise=imperfections.any,
                strict_start=False,
                backend='numba',
            )
            for number, frame in enumerate(_frames(dtype)):
                events = pixels.update((number + 1) * 1_000_000, frame)
            records_of(events, width=64, stamp_ns=3_000_000, first_index=0, backend='numba')
    # The frames that nodes take are read-only.
    rehearse(scenario('mirror', 9).replace(**_MANY_PIXELS))


def compile_controller() -> None:
    """Kernels of packets of many events, and of the design."""
    _designed(scenario('mirror', 3).replace(method='certified'))
    plain = scenario('mirror', 9)
    controller = event_controller(_designed(plain), plain)
    count = 5000
    records = np.zeros(count, EVENT_DTYPE)
    records['polarity'] = np.where(np.arange(count) % 2, -1, 1)
    records['sign'], records['index'] = 1, np.arange(count)
    # Spread over the pixels: one alone would be refused as not physically possible.
    records['x'] = np.arange(count) % plain.scene.width
    records['y'] = np.arange(count) // plain.scene.width % plain.scene.height
    controller.take(EventPacket(stamp_ns=0, events=records))


def compile_codecs() -> None:
    """Kernels of the packets of drivers."""
    bench_codecs.measure(quick=True)


def compile_exact_loop() -> None:
    """Kernels of the exact loop."""
    plain = scenario('mirror', 3)
    simulate(ClosedLoop.from_scenario(plain, _designed(plain).controller), duration=0.1)


def compile_sampled_loop() -> None:
    """The sampled loop as a whole: by far the longest."""
    run_sampled(scenario('mirror', 9).replace(duration=4.1))


def compile_promise_study() -> None:
    """The loop of the promise study."""
    run_promise_task(seed=1, method='lqg', runs=1)


_PARTS = (
    compile_sampled_loop,
    compile_camera,
    compile_promise_study,
    compile_controller,
    compile_exact_loop,
    compile_codecs,
)


def main() -> int:
    """Compile everything, a part a processor; return 0, or 1 where there is no numba."""
    if find_spec('numba') is None:
        print('numba is not installed: nothing to compile', file=sys.stderr)
        return 1
    with ProcessPoolExecutor() as pool:
        for part in [pool.submit(part) for part in _PARTS]:
            part.result()
    return 0


if __name__ == '__main__':
    sys.exit(main())
