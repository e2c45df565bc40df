"""Exact runs give the bytes that were recorded before the modules were rearranged."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from closed_loop_cases import mirror_loop, paper_plant, stiff_controller
from numerics import fingerprint

from dvs_simulation.exact import simulate

RECORDED = json.loads(Path(__file__).with_name('exact_bytes.json').read_text())
LOOPS = {
    'one pixel': lambda: mirror_loop(1),
    'three pixels': lambda: mirror_loop(3),
    'nine pixels': lambda: mirror_loop(9),
    'three pixels of the paper, signed': lambda: mirror_loop(3, signed=True),
    'stiff controller': lambda: mirror_loop(3, controller=stiff_controller(paper_plant())),
}


@pytest.mark.parametrize('name', LOOPS)
def test_an_exact_run_gives_the_recorded_bytes(name):
    if fingerprint() != RECORDED['fingerprint']:
        pytest.skip('this machine rounds otherwise than the one that recorded the bytes')
    run = simulate(
        LOOPS[name](), duration=3.0, sample_times=np.linspace(0, 3, 301), tail_start=2.0
    )
    digest = hashlib.sha256()
    events = (run.event_time, run.event_pixel, run.event_polarity, run.event_sign)
    for array in (*events, run.states, run.inputs):
        digest.update(np.ascontiguousarray(array).tobytes())

    recorded = RECORDED['runs'][name]
    assert run.event_count == recorded['events']
    assert repr(run.tail.peak_bound) == recorded['limsup']
    assert digest.hexdigest() == recorded['sha256']
