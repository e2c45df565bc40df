"""What a design promises of a run, and what keeps a run from being the one that it promises."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import StateSpace, state_response
from dvs_simulation.judging.measures import ROUNDING

_INSTANTS = 200
# Standard deviations within which a bound takes what has none: draws of every sample or event,
# and thresholds that are drawn once.
_NOISE, _FROZEN = 5.0, 3.0
# Imperfections that are compared with what the design has bounds of, and those that change
# nothing by themselves. No promise covers any other, nor one that is added.
_COVERED_PIXELS = ('threshold_mismatch', 'event_threshold_off', 'leak_rate', 'latency', 'jitter')
_DETAILS_OF_PIXELS = ('reset', 'shot_noise_luminosity', 'cutoff_luminosity', 'hot_pixel_rate')


@dataclass(frozen=True, slots=True, kw_only=True)
class Promised:
    """What the design that ran promises of thresholds and pace.

    Parameters
    ----------
    h_star
        Published bound on h.
    h_certified
        Guaranteed bound on h for the loop that runs; infinite where any threshold will do.
    delta_certified
        Relative error of the estimate up to which the tolerance is guaranteed.
    problem
        What the controller was designed for.
    loop
        The continuous closed loop without any error: x, of the states (x, xc).
    """

    h_star: float
    h_certified: float
    delta_certified: float
    problem: DesignProblem
    loop: StateSpace

    @classmethod
    def of(cls, design: Design) -> Promised:
        """What a design promises.

        Parameters
        ----------
        design
            Controller and its figures.
        """
        figures = design.figures
        return cls(
            h_star=figures.h_star,
            h_certified=figures.h_certified,
            delta_certified=figures.delta_certified,
            problem=design.problem,
            loop=state_response(design.problem.model, design.controller),
        )

    @property
    def slowest_pole(self) -> float:
        """Largest real part of a closed-loop pole, 1/s."""
        return float(self.loop.abscissa)

    def transient(self, deviation: FloatArray, begin_s: float, end_s: float) -> float:
        """Largest error between two instants that the start alone leaves, without any event.

        Parameters
        ----------
        deviation
            ``x(0) - x_d``, shape (n,).
        begin_s, end_s
            Instants after the start, s.
        """
        state = np.zeros(self.loop.order)
        state[: deviation.size] = deviation
        state = scipy.linalg.expm(self.loop.a * begin_s) @ state
        step = scipy.linalg.expm(self.loop.a * (end_s - begin_s) / _INSTANTS)
        largest = 0.0
        for _ in range(_INSTANTS + 1):
            error = self.problem.in_error_norm(self.loop.c @ state)
            largest = max(largest, float(np.linalg.norm(error)))
            state = step @ state
        return largest

    def uncovered(self, scenario: Scenario) -> str:
        """What acts on a run of a scenario and is no part of the promise; empty for nothing.

        Parameters
        ----------
        scenario
            What plant and camera got.
        """
        operation = self.problem.operation
        if operation is None:
            return ''
        return (
            _of_the_plant(scenario, self.problem, operation)
            or _of_disturbances(scenario, operation)
            or _of_the_pixels(scenario, operation)
            or _of_the_pace(scenario, operation)
        )


def _of_the_plant(scenario: Scenario, problem: DesignProblem, operation: Operation) -> str:
    plants = (problem.model, *operation.further_plants)
    if not any(_covers(plant, scenario.model, operation.model_uncertainty) for plant in plants):
        return 'state_matrix or input_matrix is beyond model_uncertainty'
    # A profile has been replaced by a line.
    straight = scenario.scene.profile is None
    if straight and not np.array_equal(scenario.model.gradients, problem.model.gradients):
        return 'output_vector differs from that of the design'
    same = np.array_equal(scenario.model.state_matrix, problem.model.state_matrix)
    if same and not np.array_equal(scenario.equilibrium.state, problem.equilibrium.state):
        return 'set_point differs from that of the design'
    return ''


def _covers(plant: PlantModel, true: PlantModel, uncertainty: float) -> bool:
    return all(
        true_entries.shape == entries.shape
        and np.all(np.abs(true_entries - entries) <= np.abs(entries) * (uncertainty + ROUNDING))
        for true_entries, entries in (
            (true.state_matrix, plant.state_matrix),
            (true.input_matrix, plant.input_matrix),
        )
    )


def _of_disturbances(scenario: Scenario, operation: Operation) -> str:
    given, room = scenario.disturbance, 1 + ROUNDING
    if given.state_disturbance:
        return 'state_disturbance'
    noise, load = _NOISE * given.input_disturbance, np.abs(scenario.constant_load)
    pushes = _per_input(operation.disturbance_bound, load.size)
    loads = _per_input(operation.constant_load, load.size)
    if np.any(noise > pushes * room):
        return 'input_disturbance is beyond disturbance_bound'
    # A constant is a disturbance as any other.
    if np.any(load > (loads + pushes - noise) * room):
        return 'constant_load is beyond constant_load_bound'
    if abs(given.output_disturbance) > operation.output_disturbance:
        return 'output_disturbance is beyond output_disturbance_bound'
    return ''


def _per_input(bounds: FloatArray, inputs: int) -> FloatArray:
    return bounds if bounds.size else np.zeros(inputs)


def _of_the_pixels(scenario: Scenario, operation: Operation) -> str:
    pixels, bounds = scenario.imperfections, operation.sensor
    for name in (entry.name for entry in fields(Imperfections)):
        known = name in _COVERED_PIXELS or name in _DETAILS_OF_PIXELS
        if not known and getattr(pixels, name):
            return name
    if pixels.reset == 'level':
        return 'reset: level'
    if scenario.sensor.photoreceptor == 'lin_log':
        return 'photoreceptor: lin_log'
    room, drawn = 1 + ROUNDING, _FROZEN * pixels.threshold_mismatch
    off = pixels.event_threshold_off / scenario.sensor.event_threshold or 1.0
    farthest_off = max(abs(off * (1 + drawn) - 1), abs(off * (1 - drawn) - 1))
    if drawn > bounds.threshold_on * room or farthest_off > bounds.threshold_off + ROUNDING:
        return 'threshold_mismatch or event_threshold_off is beyond threshold_uncertainty'
    if pixels.leak_rate > bounds.leak:
        return 'leak_rate is beyond leak_uncertainty'
    if pixels.latency + _NOISE * pixels.jitter > bounds.latency * room:
        return 'latency or jitter is beyond latency_uncertainty'
    if _FROZEN * scenario.camera.frame_noise > bounds.anchor * room and bounds.drifts:
        return 'frame_noise is beyond anchor_uncertainty'
    return ''


def _of_the_pace(scenario: Scenario, operation: Operation) -> str:
    if scenario.loop.sampling_period > operation.sampling_period:
        return 'sampling_period is longer than that of the design'
    if scenario.loop.mode == 'realtime' and not operation.latency:
        return 'loop_latency = 0, which no command on the wall clock has'
    return ''
