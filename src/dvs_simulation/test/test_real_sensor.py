"""A leaking, mismatched, lossy sensor holds the set-point by anchors, where counting fails."""

from pathlib import Path

import numpy as np
import pytest

from dvs_common.scenario.scenario import load_scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.anchor_frames import AnchorFrames
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_plant_sim.plant import Plant

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


def worst_error(seconds, *, lost=0.01, settled_s=5.0, **changes):
    """Largest distance from the set-point after the transient; infinite if the light goes out."""
    scenario = SCENARIO.replace(**changes)
    design = design_from_scenario(scenario)
    period_ns = scenario.sampling_period_ns
    plant = Plant(scenario.model, initial_state=scenario.initial_state, period_ns=period_ns)
    camera = EventCamera.of_scenario(scenario)
    frames = AnchorFrames.of_scenario(scenario)
    controller = event_controller(design, scenario)
    random = np.random.default_rng(5)
    target = scenario.equilibrium.state
    shape = scenario.pixels.pixel_grid
    worst = 0.0
    for k in range(round(seconds * 1e9 / period_ns)):
        stamp_ns = k * period_ns
        state = plant.state
        y = scenario.scene.luminosity(scenario.model, state)
        if y.min() <= 0 or not np.isfinite(y).all():
            return np.inf
        if stamp_ns > settled_s * 1e9:
            worst = max(worst, float(np.linalg.norm(state - target)))
        exposure = camera.take(
            LuminosityFrame(stamp_ns=stamp_ns, pixels=y.reshape(shape), darkest=0.0)
        )
        if not k:
            controller.take_keyframe(camera.keyframe())
        anchor = frames.take(stamp_ns, y) if frames else None
        if anchor is not None:
            controller.take_anchor(anchor)
        for packet in exposure.packets:
            if not k or random.random() >= lost:
                controller.take(packet)
        plant.advance(period_ns, controller.command)
    return worst


# An integrator settles slowly.
CASES = [
    pytest.param({}, 5.0, id='nine pixels'),
    pytest.param(ONE_PIXEL, 5.0, id='one pixel'),
    pytest.param(INTEGRATOR, 15.0, id='integrator'),
]


@pytest.mark.parametrize(('changes', 'settled_s'), CASES)
def test_anchors_hold_a_real_sensor_within_the_tolerance(changes, settled_s):
    worst = worst_error(25.0, settled_s=settled_s, **changes)
    assert worst < SCENARIO.objective.tolerance


@pytest.mark.long
@pytest.mark.parametrize(('changes', 'settled_s'), CASES)
def test_anchors_hold_a_real_sensor_for_an_hour(changes, settled_s):
    worst = worst_error(3600.0, settled_s=settled_s, **changes)
    assert worst < SCENARIO.objective.tolerance


def test_counting_alone_leaves_the_tolerance():
    assert worst_error(40.0, leak_rate=0.5, **COUNTING) > SCENARIO.objective.tolerance
