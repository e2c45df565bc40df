"""Pixels of other simulators, as `bench_camera.py` races them: from clones of their repositories.

Neither is on PyPI. `git clone` of github.com/SensorsINI/v2e and of github.com/prophesee-ai/openeb
is enough; v2e's emulator also needs the Python packages torch, dv-processing, easygui,
engineering-notation and screeninfo.
"""

from __future__ import annotations

import importlib.util
import logging
import sys
import types
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

Updater = Callable[[int, np.ndarray], int]
_OPENEB_KERNEL = (
    'sdk/modules/core_ml/python/pypkg/metavision_core_ml/video_to_event/'
    'single_image_make_events_cpu.py'
)
_EVENT_CD = np.dtype([('x', '<u2'), ('y', '<u2'), ('p', '<i2'), ('t', '<i8')])
# Grey levels of a luminosity of 1: v2e's are linear below 20.
_GREY = 50.0


def v2e_updater(clone: Path, first: np.ndarray, threshold: float, kind: str) -> Updater:
    """Update function of v2e's emulator, float32 grey levels in, events in order out.

    Parameters
    ----------
    clone
        Folder of v2e.
    first
        First frame.
    threshold
        Event threshold where `kind` does not set it.
    kind
        `clean` pixels without noise, or v2e's `noisy`.
    """
    if str(clone) not in sys.path:
        sys.path.insert(0, str(clone))
    module = import_module('v2ecore.emulator')
    logging.getLogger('v2ecore').setLevel(logging.ERROR)
    import_module('torch').set_num_threads(1)
    emulator = module.EventEmulator(
        pos_thres=threshold,
        neg_thres=threshold,
        sigma_thres=0.0,
        cutoff_hz=0,
        leak_rate_hz=0,
        shot_noise_rate_hz=0,
        refractory_period_s=0,
        device='cpu',
    )
    if kind == 'noisy':
        emulator.set_dvs_params(kind)
    emulator.generate_events(np.float32(_GREY * first), 0.0)

    def update(stamp_ns: int, frame: np.ndarray) -> int:
        events = emulator.generate_events(np.float32(_GREY * frame), stamp_ns * 1e-9)
        return 0 if events is None else len(events)

    return update


def openeb_updater(clone: Path, first: np.ndarray, threshold: float, *, in_order: bool) -> Updater:
    """Update function of OpenEB's compiled kernel with the logarithm before it.

    Parameters
    ----------
    clone
        Folder of OpenEB.
    first
        First frame.
    threshold
        Event threshold.
    in_order
        Whether events are put in order, as its `EventCPU.get_events` does.
    """
    # All that the kernel takes from the SDK, which has to be built, is the type of an event.
    base = types.ModuleType('metavision_sdk_base')
    base.__dict__['EventCD'] = _EVENT_CD
    sys.modules.setdefault('metavision_sdk_base', base)
    spec = importlib.util.spec_from_file_location('openeb_kernel', clone / _OPENEB_KERNEL)
    assert spec is not None and spec.loader is not None
    kernel = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(kernel)
    # In the midst of an epoch, as ours are: at rest they have fewer events at first.
    spread = np.random.default_rng(0).uniform(-0.99, 0.99, first.shape)
    references = np.log(first) + threshold * spread
    fired_at = np.zeros(first.shape, np.int32)
    thresholds = np.full(first.shape, threshold, np.float32)
    events = np.zeros(4 * first.size, _EVENT_CD)
    last = [0, references.copy()]

    def update(stamp_ns: int, frame: np.ndarray) -> int:
        level, now = np.log(frame), stamp_ns // 1000
        arrays = (events, references, last[1], fired_at, level)
        span = (last[0], now - last[0])
        found, _ = kernel.make_events_cpu(*arrays, *span, thresholds, thresholds, 0)
        last[:] = [now, level]
        kept = events[:found]
        if in_order:
            kept = kept[np.argsort(kept['t'])].copy()
        return len(kept)

    return update
