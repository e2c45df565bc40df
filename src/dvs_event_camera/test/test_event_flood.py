"""A step of light at a fine threshold: named and survived, in bounded memory."""

import math
import tracemalloc

import numpy as np
import pytest

from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels import event_flood
from dvs_event_camera.pixels.event_flood import EventFlood
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import SignedLogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.streams.image_source import LuminosityFrame

MS = 1_000_000


@pytest.mark.parametrize('threshold', [1e-5, 1e-12])
@pytest.mark.parametrize(
    'mode',
    [
        {'backend': 'numpy'},
        {'backend': 'numba'},
        {'interpolation': 'hermite'},
        {'imperfections': Imperfections(threshold_mismatch=1e-3)},
        {'photoreceptor': SignedLogPhotoreceptor()},
    ],
)
def test_flood_is_refused_before_it_fills_the_memory_and_the_next_sample_starts_anew(
    mode, threshold
):
    if mode.get('backend') == 'numba':
        pytest.importorskip('numba')
    array = PixelArray(event_threshold=threshold, **mode)
    array.update(0, np.full(500, 100.0))
    tracemalloc.start()
    with pytest.raises(EventFlood, match='limit of one frame is 1e'):
        array.update(MS, np.full(500, 200.0))
    assert tracemalloc.get_traced_memory()[1] < 400e6
    tracemalloc.stop()
    assert array.stamp_ns is None
    assert len(array.update(2 * MS, np.full(500, 200.0))) == 0
    assert len(array.update(3 * MS, np.full(500, 200.0 * math.exp(1.5 * threshold)))) == 500


def test_refractory_pixels_have_no_flood():
    pause = Imperfections(refractory_period=1e-4)
    array = PixelArray(event_threshold=1e-6, imperfections=pause)
    array.update(0, np.full(50, 100.0))
    assert len(array.update(MS, np.full(50, 200.0))) == 10 * 50


def test_camera_starts_again_and_logs_why(monkeypatch):
    monkeypatch.setattr(event_flood, 'MOST_EVENTS', 1000)
    values = {'event_threshold': 1e-3, 'reference_uncertainty': 0.0}
    camera = EventCamera.of_scenario(Scenario.from_values(values))

    def take(stamp, value):
        return camera.take(
            LuminosityFrame(stamp_ns=stamp, pixels=np.full((2, 1), value), darkest=0.0)
        )

    take(0, 100.0)
    below = take(MS, 100.0 * math.exp(0.4995))
    assert (len(below.events), below.restart_reason) == (2 * 499, '')
    exposure = take(2 * MS, 10.0)
    assert exposure.started
    assert 'two frames' in exposure.restart_reason
    assert len(take(3 * MS, 10.0 * math.exp(0.0015)).events) == 2
