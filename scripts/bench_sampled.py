"""Measure the sampled loop without ROS: compiled, with its messages, and message by message."""

from __future__ import annotations

import time
from collections.abc import Callable

from bench_rounds import figure

from dvs_simulation.paper.published import scenario
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.messages import messages_of
from dvs_simulation.sampled.sampled_loop import run_by_messages
from dvs_simulation.sweep.promise import run_promise_task

_ROUNDS, _SECONDS, _SHORT_SECONDS = 5, 100.0, 1.0


def _cpu_seconds(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def measure(quick: bool = False) -> dict[str, float]:
    """Cycles per CPU second at r = 9, and runs of the study `promise`.

    Parameters
    ----------
    quick
        One short round.
    """
    rounds = 1 if quick else _ROUNDS
    long = scenario('mirror', 9).replace(duration=_SECONDS / (50 if quick else 1))
    short = long.replace(duration=_SHORT_SECONDS / (5 if quick else 1))
    design = run_by_messages(short).design
    loop = compiled_loop(long, design)
    assert loop is not None
    first = loop.run()
    assert first is not None
    cycles = long.sample_count
    compiled = [cycles / _cpu_seconds(loop.run) for _ in range(rounds)]
    whole = [
        cycles / _cpu_seconds(lambda: messages_of(loop.run(), long))  # type: ignore[arg-type]
        for _ in range(rounds)
    ]
    plain = [
        short.sample_count / _cpu_seconds(lambda: run_by_messages(short, design=design))
        for _ in range(rounds)
    ]
    runs = 1 if quick else 20
    run_promise_task(seed=1, method='lqg', runs=1)
    study = [
        runs / _cpu_seconds(lambda: run_promise_task(seed=1, method='lqg', runs=runs))
        for _ in range(rounds)
    ]
    figures = {
        **figure('sampled_cycles_per_s_r9', compiled),
        **figure('sampled_messages_cycles_per_s_r9', whole),
        **figure('sampled_by_messages_cycles_per_s_r9', plain),
        **figure('sweep_promise_runs_per_core_s', study),
    }
    for name, value in figures.items():
        print(f'  {name} = {value:.4g}')
    return figures
