"""A rehearsed camera has loaded all that its first frames run."""

import sys

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import pack_image
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.compiled import kernels
from dvs_event_camera.rehearsal import rehearse
from dvs_event_camera.streams.image_source import parse_luminosity

MS = 1_000_000
GRID = {
    'pixel_offsets': [],
    'pixel_grid': [64, 64],
    'pixel_pitch': [0.0003, 0.0, 0.0, 0.0003],
    'reference_uncertainty': 0.0,
}


def loaded():
    """Forms of every compiled function of the pixels."""
    return {
        (name, key): len(value.signatures)
        for name, module in sys.modules.items()
        if name.startswith('dvs_event_camera.pixels')
        for key, value in vars(module).items()
        if hasattr(value, 'signatures') and hasattr(value, 'py_func')
    }


@pytest.mark.parametrize('noise', [{}, {'threshold_mismatch': 0.03, 'leak_rate': 0.1}])
def test_nothing_is_left_to_load_for_the_frames_after_it(noise):
    if kernels() is None:
        pytest.skip('no numba')
    scenario = Scenario.from_values({**GRID, **noise})
    rehearse(scenario)
    before = loaded()
    camera = EventCamera.of_scenario(scenario)
    light = scenario.scene.luminosity(scenario.model, scenario.initial_state).reshape(64, 64)
    events = 0
    for k in range(20):
        frame = pack_image(k * MS, light * 1.03**k, '64FC1')
        events += len(camera.take(parse_luminosity(frame)).events)

    assert events > 4096
    assert any(before.values())
    assert loaded() == before


def test_a_small_array_and_a_scene_without_light_are_left_alone():
    rehearse(Scenario.from_values({}))
    dark = Scenario.from_values({**GRID, 'initial_state': [-1.0, -1.0]})
    assert np.all(dark.scene.luminosity(dark.model, dark.initial_state) < 0)
    rehearse(dark)
