"""A leaking, mismatched, lossy sensor holds the set-point by anchors, where counting fails."""

from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.scenario import load_scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_simulation.sampled.real_sensor import LossyRun, worst_error

pytestmark = pytest.mark.ensemble

CONFIG = Path(__file__).resolve().parents[3] / 'config'
SCENARIO = load_scenario(CONFIG / 'real_sensor.yaml')
COUNTING = {
    'frame_rate': 0.0,
    'threshold_uncertainty': (),
    'leak_uncertainty': 0.0,
}
ONE_PIXEL = {'pixel_offsets': (0.0, 0.0), 'pixel_grid': (1, 1)}
# x' = u, with the light c'x + 1 of nine pixels that see it at slightly different places.
INTEGRATOR = {
    'state_matrix': (0.0,),
    'input_matrix': (1.0,),
    'output_vector': (1.0,),
    'pixel_offsets': tuple(np.linspace(0.9, 1.1, 9)),
    'pixel_grid': (3, 3),
    'initial_state': (0.25,),
    'set_point': (0.0,),
}


def worst(seconds, *, settled_s=5.0, **changes):
    return worst_error(SCENARIO.replace(**changes), LossyRun(duration=seconds, settled=settled_s))


# An integrator settles slowly.
CASES = [
    pytest.param({}, 5.0, id='nine pixels'),
    pytest.param(ONE_PIXEL, 5.0, id='one pixel'),
    pytest.param(INTEGRATOR, 15.0, id='integrator'),
]


@pytest.mark.parametrize(('changes', 'settled_s'), CASES)
def test_anchors_hold_a_real_sensor_within_the_tolerance(changes, settled_s):
    assert worst(25.0, settled_s=settled_s, **changes) < SCENARIO.objective.tolerance


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(('changes', 'settled_s'), CASES)
def test_anchors_hold_a_real_sensor_for_an_hour(changes, settled_s):
    assert worst(3600.0, settled_s=settled_s, **changes) < SCENARIO.objective.tolerance


def test_a_leaking_sensor_without_anchors_leaves_the_tolerance():
    assert worst(40.0, leak_rate=0.5, **COUNTING) > SCENARIO.objective.tolerance


@pytest.mark.parametrize('leak', [0.02, 0.1, 2.0])
def test_the_references_of_a_leaking_camera_lie_in_their_intervals_at_every_packet(leak):
    """Light that stands still, ON events of leakage alone, and a controller that only counts."""
    leaking = SCENARIO.replace(
        leak_rate=leak,
        leak_uncertainty=leak,
        threshold_mismatch=0.0,
        threshold_uncertainty=(),
        latency=0.0,
        jitter=0.0,
        frame_rate=0.0,
    )
    camera = EventCamera.of_scenario(leaking)
    controller = event_controller(design_from_scenario(leaking), leaking)
    y = leaking.scene.luminosity(leaking.model, leaking.initial_state)
    events = 0
    for k in range(400):
        exposure = camera.take(
            LuminosityFrame(stamp_ns=k * 200_000_000, pixels=y.reshape(3, 3), darkest=0.0)
        )
        if not k:
            controller.take_keyframe(camera.keyframe())
        for packet in exposure.packets:
            controller.take(packet)
            events += len(packet.events)
            off = np.abs(controller.estimate - y) / y
            assert np.all(off <= controller.references.intervals.error_bounds * (1 + 1e-9)), k
    assert events >= 9 * int(79 * leak)
    # The certificate knows how long this can go on.
    assert not controller.read_budget(0.1).is_certified
