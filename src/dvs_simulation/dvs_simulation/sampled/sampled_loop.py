"""The sampled loop without ROS: the nodes' own cores in one process, message by message.

Drives the same cores in the same order as the nodes do in lockstep, through the same serialized
messages, so that it gives the bytes of the ROS loop at any sampling period. (A middleware may fill
a message up to a multiple of four bytes on its way.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.model import PixelScene
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import pack_events, parse_events
from dvs_common.wire.messages import (
    Vector,
    pack_command,
    pack_estimate,
    pack_image,
    pack_state,
    parse_command,
)
from dvs_common.wire.topics import COMMAND, ESTIMATE, EVENTS, LUMINOSITY, STATE
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.anchor_frames import AnchorFrames
from dvs_event_camera.streams.event_records import without_labels
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_hinf_controller.design.design import Design, design_from_scenario
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_plant_sim.disturbance import disturbed
from dvs_plant_sim.dynamics import Dynamics
from dvs_plant_sim.plant import Plant

Optics = Callable[[FloatArray], FloatArray]

_TOPICS = (LUMINOSITY, STATE, EVENTS, COMMAND, ESTIMATE)


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledRun:
    """Serialized messages of a sampled run.

    Parameters
    ----------
    messages
        CDR bytes by topic, in the order of their publication.
    design
        The controller that ran.
    controller
        It, as the run has left it.
    """

    messages: dict[str, list[bytes]] = field(default_factory=dict)
    design: Design
    controller: EventController


def run_sampled(
    scenario: Scenario, *, plant: Dynamics | None = None, luminosity: Optics | None = None
) -> SampledRun:
    """Run a scenario in lockstep at its `sampling_period`, without ROS.

    Parameters
    ----------
    scenario
        Checked parameters.
    plant
        Plant at its initial state; None for the linear one of the scenario.
    luminosity
        What every pixel sees of a state, (n,) to (r,); None for ``c'(x + dx_i)``.

    Raises
    ------
    ParameterError
        If the run has no end, parameters do not fit, (A1) is violated, or a luminosity is not
        positive where `nonphysical_luminosity` says to stop.
    SynthesisError
        If no controller exists.
    """
    if not scenario.sample_count:
        raise ParameterError('duration', scenario.loop.duration, 'must be > 0 for a sampled run')
    model = scenario.model
    model.require_stabilizable()
    model.require_detectable()
    design = design_from_scenario(scenario)
    run = SampledRun(
        design=design,
        controller=event_controller(design, scenario),
        messages={name: [] for name in _TOPICS},
    )
    linear = Plant(
        model, initial_state=scenario.initial_state, period_ns=scenario.sampling_period_ns
    )
    moving = disturbed(plant or linear, scenario)
    scene = scenario.scene
    sees = luminosity or partial(scene.luminosity, model)
    unknown = scenario.disturbance.output_disturbance
    camera = EventCamera.of_scenario(scenario)
    controller = run.controller
    frames = AnchorFrames.of_scenario(scenario)
    for sample in range(scenario.sample_count + 1):
        stamp_ns = sample * scenario.sampling_period_ns
        state = moving.state
        image = _publish_sample(run, scenario, scene, state, sees(state) + unknown, stamp_ns)
        packets = _expose(run, camera, image)
        _tell(controller, camera, frames, image, is_first=not sample)
        command = _command(run, controller, packets)
        if sample < scenario.sample_count:
            moving.advance(scenario.sampling_period_ns, command)
    return run


def _publish_sample(
    run: SampledRun,
    scenario: Scenario,
    scene: PixelScene,
    state: FloatArray,
    luminosity: FloatArray,
    stamp_ns: int,
) -> bytes:
    if scenario.sensor.photoreceptor == 'log' and luminosity.min() <= 0:
        luminosity = _nonphysical(scenario, luminosity, stamp_ns)
    image = pack_image(stamp_ns, luminosity.reshape(scene.height, scene.width), '64FC1')
    names = tuple(f'x{i + 1}' for i in range(state.size))
    run.messages[LUMINOSITY].append(image)
    run.messages[STATE].append(pack_state(Vector(stamp_ns=stamp_ns, names=names, values=state)))
    return image


def _nonphysical(scenario: Scenario, luminosity: FloatArray, stamp_ns: int) -> FloatArray:
    policy = scenario.loop.nonphysical_luminosity
    if policy == 'stop':
        raise ParameterError(
            'initial_state',
            scenario.initial_state.tolist(),
            f'leads to the luminosity {luminosity.min():.6g} <= 0 at {as_seconds(stamp_ns):.6f} s '
            '(nonphysical_luminosity: stop; photoreceptor: log)',
        )
    return np.maximum(luminosity, scenario.sensor.dead_band) if policy == 'clamp' else luminosity


def _expose(run: SampledRun, camera: EventCamera, image: bytes) -> list[bytes]:
    exposure = camera.take(parse_luminosity(image))
    assert exposure is not None
    packets = [pack_events(without_labels(packet)) for packet in exposure.packets]
    run.messages[EVENTS] += packets
    return packets


def _tell(
    controller: EventController,
    camera: EventCamera,
    frames: AnchorFrames | None,
    image: bytes,
    *,
    is_first: bool,
) -> None:
    """Keyframe of the start and anchors, which go before the packet of their sample."""
    if is_first:
        controller.take_keyframe(camera.keyframe())
    if frames is not None:
        frame = parse_luminosity(image)
        anchor = frames.take(frame.stamp_ns, frame.pixels)
        if anchor is not None:
            controller.take_anchor(anchor)


def _command(run: SampledRun, controller: EventController, packets: list[bytes]) -> FloatArray:
    """Command that answers the last of the packets, as the plant reads it."""
    message = b''
    for packet in map(parse_events, packets):
        controller.take(packet)
        names = tuple(f'u{i + 1}' for i in range(controller.command.size))
        message = pack_command(
            Vector(stamp_ns=packet.stamp_ns, names=names, values=controller.command)
        )
        run.messages[COMMAND].append(message)
        run.messages[ESTIMATE].append(pack_estimate(packet.stamp_ns, controller.estimate))
    return parse_command(message).values
