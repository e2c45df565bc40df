"""The sampled loop without ROS: the nodes' own cores in one process, or compiled as a whole.

`run_by_messages` drives the same cores in the same order as the nodes do in lockstep, through the
same serialized messages, so that it gives the bytes of the ROS loop at any sampling period. (A
middleware may fill a message up to a multiple of four bytes on its way.) `run_sampled` gives the
same bytes, from compiled code where the scenario has nothing but what is compiled.
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
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.conditions import AS_IN_SCENARIO, Conditions
from dvs_simulation.sampled.messages import messages_of
from dvs_simulation.sampled.schedule import Schedule

Optics = Callable[[FloatArray], FloatArray]

_TOPICS = (LUMINOSITY, STATE, EVENTS, COMMAND, ESTIMATE)
# Samples from which on compiled code pays: loading it takes a second or two.
_WORTH_COMPILING = 4000


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
        It, as the run has left it; None where compiled code ran in its place, with the same bytes.
    """

    messages: dict[str, list[bytes]] = field(default_factory=dict)
    design: Design
    controller: EventController | None

    @property
    def compiled(self) -> bool:
        """Whether compiled code made the messages."""
        return self.controller is None


def run_sampled(
    scenario: Scenario,
    *,
    plant: Dynamics | None = None,
    luminosity: Optics | None = None,
    conditions: Conditions = AS_IN_SCENARIO,
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
    conditions
        What acts on the run beside the scenario.

    Raises
    ------
    ParameterError
        If the run has no end, parameters do not fit, (A1) is violated, or a luminosity is not
        positive where `nonphysical_luminosity` is `stop`.
    SynthesisError
        If no controller exists.
    """
    own = plant is None and luminosity is None
    if own and scenario.sample_count >= _WORTH_COMPILING:
        design = _design(scenario)
        loop = compiled_loop(scenario, design)
        found = None if loop is None else loop.run(conditions)
        if found is not None and found.is_whole:
            messages = messages_of(found, scenario)
            return SampledRun(messages=messages, design=design, controller=None)
        return run_by_messages(scenario, conditions=conditions, design=design)
    return run_by_messages(scenario, plant=plant, luminosity=luminosity, conditions=conditions)


def _design(scenario: Scenario) -> Design:
    scenario.model.require_stabilizable()
    scenario.model.require_detectable()
    return design_from_scenario(scenario)


def run_by_messages(
    scenario: Scenario,
    *,
    plant: Dynamics | None = None,
    luminosity: Optics | None = None,
    conditions: Conditions = AS_IN_SCENARIO,
    design: Design | None = None,
) -> SampledRun:
    """Run a scenario message by message through the nodes' cores: the reference.

    Parameters
    ----------
    scenario, plant, luminosity, conditions
        See `run_sampled`.
    design
        Controller; None to design it.

    Raises
    ------
    ParameterError, SynthesisError
        See `run_sampled`.
    """
    if not scenario.sample_count:
        raise ParameterError('duration', scenario.loop.duration, 'must be > 0 for a sampled run')
    model = scenario.model
    design = design or _design(scenario)
    conditions.check(
        samples=scenario.sample_count + 1, states=model.state_count, inputs=model.input_count
    )
    controller = event_controller(design, scenario)
    run = SampledRun(design=design, controller=controller, messages={name: [] for name in _TOPICS})
    plant_input = _PlantInput(scenario, plant or _linear_plant(scenario, conditions), conditions)
    scene = scenario.scene
    sees = luminosity or partial(scene.luminosity, model)
    unknown = scenario.disturbance.output_disturbance
    camera = EventCamera.of_scenario(scenario, first_reference=conditions.first_reference)
    frames = AnchorFrames.of_scenario(scenario)
    for sample in range(scenario.sample_count + 1):
        stamp_ns = sample * scenario.sampling_period_ns
        state = plant_input.moving.state
        image = _publish_sample(run, scenario, scene, state, sees(state) + unknown, stamp_ns)
        packets = _expose(run, camera, image)
        _give_references(controller, camera, frames, image, is_first=not sample)
        if not plant_input.schedule.lost[sample]:
            plant_input.commands[sample] = _command(run, controller, packets)
        if sample < scenario.sample_count:
            plant_input.advance(sample)
    return run


def _linear_plant(scenario: Scenario, conditions: Conditions) -> Plant:
    start = conditions.initial_state
    return Plant(
        conditions.plant or scenario.model,
        initial_state=scenario.initial_state if start is None else start,
        period_ns=scenario.sampling_period_ns,
    )


class _PlantInput:
    """The plant, and which command acts on it when."""

    def __init__(self, scenario: Scenario, plant: Dynamics, conditions: Conditions) -> None:
        self.moving = disturbed(plant, scenario)
        self.commands: dict[int, FloatArray] = {-1: scenario.equilibrium.feedforward}
        self._push = conditions.disturbance
        self.schedule = Schedule.of(
            conditions, periods=scenario.sample_count, period_ns=scenario.sampling_period_ns
        )

    def advance(self, sample: int) -> None:
        """Move from a sample to the next."""
        schedule = self.schedule
        for piece in range(schedule.first_piece[sample], schedule.first_piece[sample + 1]):
            command = self.commands[int(schedule.commands[piece])]
            if self._push is not None:
                command = command + self._push[sample]
            self.moving.advance(int(schedule.lengths_ns[piece]), command)


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


def _give_references(
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
