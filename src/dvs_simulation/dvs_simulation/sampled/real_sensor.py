"""A loop with a sensor as it is: leak, mismatch, latency, and packets that are lost on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.nanoseconds import as_nanoseconds
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.anchor_frames import AnchorFrames
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_hinf_controller.design.design import Design, design_from_scenario
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_plant_sim.plant import Plant
from dvs_simulation.judging.measures import error


@dataclass(frozen=True, slots=True, kw_only=True)
class LossyRun:
    """How long a loop runs, and what is lost.

    Parameters
    ----------
    duration
        Simulated time, s.
    settled
        Time from which on the error counts, s.
    lost
        Share of the packets that never arrive.
    seed
        Of what is lost.
    """

    duration: float
    settled: float = 5.0
    lost: float = 0.01
    seed: int = 5


def worst_error(scenario: Scenario, run: LossyRun, design: Design | None = None) -> float:
    """Largest ``||W (x - x_d)||`` once settled; infinite after a luminosity that is not positive.

    The cores of the nodes take turns; only the first packet is sure to arrive. The run ends where
    the error exceeds the tolerance tenfold.

    Parameters
    ----------
    scenario
        Sensor, plant and controller.
    run
        Duration and losses.
    design
        Controller, where it is there already.
    """
    design = design or design_from_scenario(scenario)
    period_ns = scenario.sampling_period_ns
    plant = Plant(scenario.model, initial_state=scenario.initial_state, period_ns=period_ns)
    camera = EventCamera.of_scenario(scenario)
    frames = AnchorFrames.of_scenario(scenario)
    controller = event_controller(design, scenario)
    random = np.random.default_rng(run.seed)
    shape = scenario.pixels.pixel_grid
    model, scene = scenario.model, scenario.scene
    worst = 0.0
    for stamp_ns in range(0, as_nanoseconds(run.duration), period_ns):
        state = plant.state
        y = scene.luminosity(model, state)
        if not (y.min() > 0 and np.isfinite(y).all()):
            return math.inf
        if stamp_ns > as_nanoseconds(run.settled):
            worst = max(worst, float(error(state, scenario.equilibrium, scenario.error_weights)))
            if worst > 10 * scenario.objective.tolerance:
                return worst
        exposure = camera.take(
            LuminosityFrame(stamp_ns=stamp_ns, pixels=y.reshape(shape), darkest=0.0)
        )
        if not stamp_ns:
            controller.take_keyframe(camera.keyframe())
        anchor = frames.take(stamp_ns, y) if frames else None
        if anchor is not None:
            controller.take_anchor(anchor)
        for packet in exposure.packets if exposure else ():
            if not stamp_ns or random.random() >= run.lost:
                controller.take(packet)
        plant.advance(period_ns, controller.command)
    return worst
