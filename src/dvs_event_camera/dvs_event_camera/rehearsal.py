"""A camera that takes two frames before the first real one, so that what it runs is loaded."""

from __future__ import annotations

from contextlib import suppress

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.messages import pack_image
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.compiled import WORTH_COMPILING
from dvs_event_camera.streams.image_source import parse_luminosity

# Of the luminosity in a period: most pixels fire.
_CHANGE = 2.0


def rehearse(scenario: Scenario) -> None:
    """Load the compiled code of the pixels of a loop: its first events would wait for a second.

    Small arrays, which need none, and scenes that no camera can start with are left alone.

    Parameters
    ----------
    scenario
        Checked parameters, the pixels and the plant among them.
    """
    scene = scenario.scene
    if scene.pixel_count < WORTH_COMPILING:
        return
    camera = EventCamera.of_scenario(scenario)
    light = scene.luminosity(scenario.model, scenario.initial_state)
    light = light.reshape(scene.height, scene.width)
    with suppress(ParameterError):
        for k, frame in enumerate((light, _CHANGE * light)):
            stamp_ns = k * scenario.sampling_period_ns
            camera.take(parse_luminosity(pack_image(stamp_ns, frame, '64FC1')))
