"""Pixels that are dark in the first frame: they wait, and nothing else is touched."""

import math

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import SignedLogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.streams.image_source import LuminosityFrame

MS = 1_000_000
MODES = [
    {},
    {'backend': 'numba'},
    {'interpolation': 'hermite'},
    {'imperfections': Imperfections(refractory_period=1e-6)},
    {'imperfections': Imperfections(threshold_mismatch=1e-9)},
    {'photoreceptor': SignedLogPhotoreceptor()},
    {'bounds': ReferenceBounds(lower=np.ones(3), upper=np.ones(3))},
]


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('dark', [math.nan, math.inf, 0.0, -2.0])
def test_pixel_without_light_starts_with_its_first_luminosity(mode, dark):
    if 'photoreceptor' in mode and math.isfinite(dark):
        pytest.skip('negative light means something to this photoreceptor')
    if mode.get('backend') == 'numba':
        pytest.importorskip('numba')
    array = PixelArray(event_threshold=0.1, **mode)
    array.update(0, [1.0, dark, 1.0])
    assert array.waiting_pixels == 1
    assert len(array.update(MS, [1.0, dark, 1.0])) == 0
    still = array.update(2 * MS, [1.0, 5.0, math.exp(0.25)])
    assert still.pixel.tolist() == [2, 2]
    assert array.waiting_pixels == 0
    moved = array.update(3 * MS, [1.0, 5.0 * math.exp(-0.35), math.exp(0.25)])
    assert (moved.pixel.tolist(), moved.polarity.tolist()) == ([1] * 3, [-1] * 3)
    # The level is linear in time between the samples (but a cubic knows more neighbours).
    if mode.get('interpolation') != 'hermite':
        assert moved.t[0] == pytest.approx(2 * MS + MS * 0.1 / 0.35, abs=2)
    assert array.counts.tolist() == [0, -3, 2]


@pytest.mark.parametrize(
    'imperfections',
    [
        Imperfections(leak_rate=20.0),
        Imperfections(cutoff_frequency=1e3),
        Imperfections(dead_pixel_fraction=1.0),
        Imperfections(hot_pixel_fraction=1.0, hot_pixel_rate=20.0),
    ],
)
def test_late_pixel_is_as_imperfect_as_the_others_from_its_first_light_on(imperfections):
    array = PixelArray(event_threshold=0.1, imperfections=imperfections, label_noise=True)
    array.update(0, [math.nan] * 50)
    for k in range(1, 100):
        assert len(array.update(10 * k * MS, [math.nan] * 50)) == 0
    assert len(array.update(1000 * MS, [3.0] * 50)) == 0
    later = array.update(2000 * MS, [3.0] * 50)
    rate = imperfections.leak_rate or imperfections.hot_pixel_fraction * 20.0
    assert len(later) == pytest.approx(rate * 50, abs=50)
    assert np.all(later.noise == 1)


@pytest.mark.parametrize(
    ('pixels', 'darkest', 'values'),
    [
        (np.array([[0, 50], [100, 255]], 'u1'), 0.5, {'photoreceptor': 'lin_log'}),
        (np.linspace(0, 1, 16, dtype='f4').reshape(4, 4), 0.0, {}),
        (np.linspace(0, 1, 16, dtype='f4').reshape(4, 4), 0.0, {'log_floor': 0.001}),
        (np.linspace(0, 1, 16, dtype='f4').reshape(4, 4), 0.0, {'log_floor': 0.01}),
        (np.array([[np.nan, 5.0], [5.0, 5.0]]), 0.0, {}),
        (np.zeros((2, 2)), 0.0, {}),
    ],
)
def test_camera_without_a_stated_uncertainty_starts_with_any_picture(pixels, darkest, values):
    camera = EventCamera.of_scenario(Scenario.from_values(values))
    exposure = camera.take(LuminosityFrame(stamp_ns=0, pixels=pixels, darkest=darkest))
    assert exposure.started
    exposure = camera.take(LuminosityFrame(stamp_ns=MS, pixels=pixels, darkest=darkest))
    assert len(exposure.events) == 0


def test_stated_uncertainty_is_a_claim_that_the_first_frame_must_keep():
    camera = EventCamera.of_scenario(Scenario.from_values({'reference_uncertainty': 0.5}))
    with pytest.raises(ParameterError, match='pixel 1'):
        camera.take(LuminosityFrame(stamp_ns=0, pixels=np.array([[100.0, 1.0]]), darkest=0.0))
