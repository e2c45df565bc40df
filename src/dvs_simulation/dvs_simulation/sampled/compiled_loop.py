"""The sampled loop compiled as a whole, where a scenario has nothing but what is compiled.

Compiled: the linear plant with its noise, any conditions, ideal pixels with the paper's logarithm,
OFF thresholds of their own, mismatch, refractory period, reset to the level, leakage, hot and dead
pixels, and a controller with uncertain thresholds, leakage, masked pixels and lost events. Not
compiled: other photoreceptors and interpolations, shot noise, the low-pass, delayed events,
frames beside the events, constant disturbances, limits of commands, brightness profiles, and what
leaves a reference unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.scenario import Scenario
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.comparators import NumpyComparator
from dvs_event_camera.pixels.engine import NumpyPixels
from dvs_event_camera.pixels.imperfect_comparator import ImperfectComparator
from dvs_event_camera.pixels.level_stages import DeadPixels, Leak
from dvs_event_camera.pixels.photoreceptor import LogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.streams.image_source import LuminosityFrame
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.running.held_input import HeldInputResponse
from dvs_hinf_controller.running.make_controller import event_controller
from dvs_hinf_controller.running.pixel_records import FEW_PIXELS
from dvs_plant_sim.plant import held_input_step
from dvs_simulation.exact.compilation import numba_available
from dvs_simulation.sampled.conditions import AS_IN_SCENARIO, Conditions
from dvs_simulation.sampled.kernel.layout import (
    DONE,
    UNUSUAL,
    ControlArrays,
    EstimateArrays,
    PixelArrays,
    PlantArrays,
    Record,
)
from dvs_simulation.sampled.numpy_loops import Loops, numpy_loops
from dvs_simulation.sampled.schedule import Schedule

_KEY_BITS = 63


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledRun:
    """What a compiled run leaves.

    Parameters
    ----------
    record
        Rows by sample.
    samples
        Rows that are there: all N + 1, unless a luminosity was not positive.
    is_whole
        Whether all are.
    lost
        Samples without a command, shape (N + 1,).
    times_ns
        Time of every event, ns, shape (E,).
    pixels
        Its pixel, shape (E,).
    polarities
        +1 or -1, shape (E,).
    """

    record: Record
    samples: int
    is_whole: bool
    lost: NDArray[np.bool_]
    times_ns: NDArray[np.int64]
    pixels: NDArray[np.int64]
    polarities: NDArray[np.int8]


class CompiledLoop:
    """Runs of one scenario and one controller.

    Parameters
    ----------
    scenario
        Checked parameters, with an end.
    design
        The controller.
    run
        The compiled function.
    loops
        NumPy's inner loops.
    """

    def __init__(self, scenario: Scenario, design: Design, run: Any, loops: Loops) -> None:
        self._scenario, self._design, self._run, self._loops = scenario, design, run, loops
        self._model, self._scene = scenario.model, scenario.scene
        self._period_ns, self._periods = scenario.sampling_period_ns, scenario.sample_count

    def run(self, conditions: Conditions = AS_IN_SCENARIO) -> CompiledRun | None:
        """Run once; None for what only the nodes' cores can do.

        Parameters
        ----------
        conditions
            What acts on the run.

        Raises
        ------
        ParameterError
            If the conditions do not fit or (A1) is violated.
        """
        model = self._model
        conditions.check(
            samples=self._periods + 1, states=model.state_count, inputs=model.input_count
        )
        start = conditions.initial_state
        state = np.array(self._scenario.initial_state if start is None else start, np.float64)
        light = self._scene.luminosity(model, state)
        if not light.min() > 0:
            return None
        camera = EventCamera.of_scenario(
            self._scenario, backend='numpy', first_reference=conditions.first_reference
        )
        controller = event_controller(self._design, self._scenario)
        shape = (self._scene.height, self._scene.width)
        exposure = camera.take(
            LuminosityFrame(stamp_ns=0, pixels=light.reshape(shape), darkest=0.0)
        )
        assert exposure is not None and camera.pixels is not None
        controller.take_keyframe(camera.keyframe())
        controller.take(exposure.packets[-1])
        pixels = _pixel_arrays(camera.pixels)
        schedule = Schedule.of(conditions, periods=self._periods, period_ns=self._period_ns)
        seconds = _gaps_of(schedule, self._period_ns)
        known = _estimate_arrays(controller, seconds)
        control = self._control_arrays(controller, seconds)
        if pixels is None or known is None or control is None:
            return None
        record = self._record(state, light, controller)
        shift = 2 + max(1, int(light.size - 1).bit_length())
        if shift + self._period_ns.bit_length() > _KEY_BITS:
            return None
        how, samples, times, lows = self._run(
            self._loops,
            self._plant_arrays(state, conditions, schedule),
            pixels,
            known,
            control,
            record,
            self._period_ns,
            schedule.lost,
            shift,
        )
        if how == UNUSUAL:
            return None
        return CompiledRun(
            record=record,
            samples=samples,
            is_whole=how == DONE,
            lost=schedule.lost,
            times_ns=times,
            pixels=lows >> 2,
            polarities=((lows & 2) - 1).astype(np.int8),
        )

    def _record(self, state: Any, light: Any, controller: EventController) -> Record:
        size = self._periods + 1
        record = Record(
            states=np.full((size, state.size), math.nan),
            luminosities=np.full((size, light.size), math.nan),
            commands=np.zeros((size, self._model.input_count)),
            estimates=np.empty((size, light.size)),
            first_event=np.zeros(size + 1, np.int64),
        )
        record.states[0], record.luminosities[0] = state, light
        record.commands[0], record.estimates[0] = controller.command, controller.estimate
        return record

    def _plant_arrays(self, state: Any, conditions: Conditions, schedule: Schedule) -> PlantArrays:
        true = conditions.plant or self._model
        lengths, which = np.unique(schedule.lengths_ns, return_inverse=True)
        steps = [held_input_step(true, int(length)) for length in lengths]
        input_noise, state_noise = self._noise(schedule)
        push = np.empty((0, self._model.input_count))
        if conditions.disturbance is not None:
            push = np.ascontiguousarray(conditions.disturbance[schedule.samples_of_pieces()])
        return PlantArrays(
            state=state.copy(),
            transitions=np.stack([transition for transition, _ in steps]),
            gains=np.stack([gain for _, gain in steps]),
            gradient=np.ascontiguousarray(self._model.gradient),
            offsets=np.ascontiguousarray(self._scene.brightness_offsets),
            first_piece=np.asarray(schedule.first_piece, np.int64),
            lengths=np.asarray(which, np.int64),
            commands=np.asarray(schedule.commands, np.int64),
            push=push,
            input_noise=input_noise,
            state_noise=state_noise,
        )

    def _noise(self, schedule: Schedule) -> tuple[Any, Any]:
        """The draws of `DisturbedPlant`, piece by piece."""
        wanted = self._scenario.disturbance
        n, m = self._model.state_count, self._model.input_count
        m *= bool(wanted.input_disturbance)
        n *= bool(wanted.state_disturbance)
        pieces = schedule.lengths_ns.size
        random = np.random.default_rng(self._scenario.loop.seed)
        draws = random.standard_normal((pieces, m + n)) if m + n else np.empty((0, 0))
        spread = wanted.state_disturbance * np.sqrt(as_seconds(schedule.lengths_ns))
        none = np.empty((0, 0))
        return (
            np.ascontiguousarray(wanted.input_disturbance * draws[:, :m]) if m else none,
            np.ascontiguousarray(spread[:, None] * draws[:, m:]) if n else none,
        )

    def _control_arrays(
        self, controller: EventController, seconds: list[float]
    ) -> ControlArrays | None:
        response, k = controller.response, self._design.controller
        if not isinstance(response, HeldInputResponse) or not response.is_modal:
            return None
        if controller.limiter is not None:
            return None
        real = not np.iscomplexobj(response.poles)
        # As NumPy casts it for a product: what is turned and cast becomes contiguous.
        vectors = np.ascontiguousarray(response.vectors.T) if real else response.vectors
        return ControlArrays(
            state=controller.state.copy(),
            transitions=np.stack([response.transition(one) for one in seconds]),
            gains=np.stack([response.response(np.array([one]))[0] for one in seconds]),
            output=np.ascontiguousarray(k.output_matrix, np.float64),
            feedthrough=np.ascontiguousarray(k.feedthrough, np.float64),
            feedforward=np.ascontiguousarray(self._design.problem.equilibrium.feedforward),
            deviation=np.array([controller.deviation]),
            poles=response.poles.astype(np.complex128),
            real=real,
            modal_input=response.modal_input.astype(np.complex128),
            vectors=np.ascontiguousarray(vectors.astype(np.complex128)),
            turned=not real,
            nanosecond_s=as_seconds(1),
        )


def _gaps_of(schedule: Schedule, period_ns: int) -> list[float]:
    """Times from one packet to the next that a run can have, s, by their number of periods."""
    longest = int(np.diff(np.flatnonzero(~schedule.lost)).max(initial=1))
    return [as_seconds(count * period_ns) for count in range(1, longest + 1)]


@cache
def _loaded() -> Any | None:
    """The compiled function; None where it cannot be had."""
    if not numba_available() or numpy_loops() is None:
        return None
    config: Any = import_module('numba').config
    if config.DISABLE_JIT:
        return None
    return import_module('dvs_simulation.sampled.kernel.run').run


def compiled_loop(scenario: Scenario, design: Design) -> CompiledLoop | None:
    """Compiled loop of a scenario; None where it has what is not compiled, or without numba.

    Parameters
    ----------
    scenario
        Checked parameters, with an end.
    design
        The controller.
    """
    run, loops = _loaded(), numpy_loops()
    imperfections = scenario.imperfections
    if (
        run is None
        or loops is None
        or scenario.camera.frame_rate
        or scenario.scene.groups is not None
    ):
        return None
    if scenario.sensor.photoreceptor != 'log' or scenario.camera.interpolation != 'linear_log':
        return None
    if imperfections.shot_noise_rate or imperfections.cutoff_frequency:
        return None
    if np.any(scenario.constant_load) or scenario.disturbance.output_disturbance:
        return None
    if scenario.profile.brightness_profile:
        return None
    return CompiledLoop(scenario, design, run, loops)


def _pixel_arrays(array: PixelArray) -> PixelArrays | None:
    engine = array.engine
    stages = {type(stage) for stage in array.stages}
    if array.waiting_pixels or array.delay is not None or not stages <= {Leak, DeadPixels}:
        return None
    if not isinstance(engine, NumpyPixels) or not isinstance(
        engine.photoreceptor, LogPhotoreceptor
    ):
        return None
    comparator = engine.comparator
    leak = next((stage for stage in array.stages if isinstance(stage, Leak)), None)
    dead = next((stage for stage in array.stages if isinstance(stage, DeadPixels)), None)
    size = comparator.counts.size
    none, no_floats = np.empty(0, np.int64), np.empty(0)
    ideal = type(comparator) is NumpyComparator
    if not ideal and not isinstance(comparator, ImperfectComparator):
        return None
    state = comparator.state if isinstance(comparator, ImperfectComparator) else None
    no_counts = np.empty(0, np.int32)
    if isinstance(comparator, NumpyComparator):
        # This comparator keeps distances in steps; the compiled one takes levels.
        level, origin = array.first_levels.copy(), comparator.origin
    else:
        assert state is not None and isinstance(comparator, ImperfectComparator)
        level, origin = comparator.previous.copy(), state.origin
    return PixelArrays(
        level=level,
        origin=origin.copy(),
        counts=np.array(comparator.counts, np.int32),
        step=array.log_step,
        floor=engine.photoreceptor.log_floor,
        numbers=np.arange(size, dtype=np.int32),
        ideal=state is None,
        ladder=state is None or state.ladder,
        present=no_floats if state is None else state.present.copy(),
        on=no_counts if state is None else state.on.copy(),
        off=no_counts if state is None else state.off.copy(),
        on_thresholds=no_floats if state is None else state.on_thresholds,
        off_thresholds=no_floats if state is None else state.off_thresholds,
        refractory_ns=0 if state is None else state.refractory_ns,
        ready_ns=none if state is None else state.ready_ns.copy(),
        leaks=leak is not None,
        phase=no_floats if leak is None else leak.phase,
        rates=no_floats if leak is None else leak.rates,
        dead=none if dead is None else dead.dead,
        frozen=no_floats if dead is None else dead.frozen,
        nanosecond_s=as_seconds(1),
    )


def _estimate_arrays(controller: EventController, seconds: list[float]) -> EstimateArrays | None:
    known, target = controller.references.intervals, controller.problem.set_point_luminosity
    if known.has_lost or not known.known.all() or controller.lacks_pixels:
        return None
    if not np.all(known.signs == 1) or known.estimate.size > FEW_PIXELS:
        return None
    bounds, spacings = known.step_bounds, known.step_bounds.spacings
    leak = bounds.uncertainty.leak
    is_all = known.active_count == known.active.size
    return EstimateArrays(
        counts=known.counts.copy(),
        estimate=known.estimate.copy(),
        first=known.first.copy(),
        lower=known.lower.copy(),
        upper=known.upper.copy(),
        counted_lower=known.lower.copy(),
        counted_upper=known.upper.copy(),
        active=known.active.copy(),
        active_count=known.active_count,
        target=float(target.mean() if is_all else target[known.active].mean()),
        step=bounds.step,
        on=bounds.on,
        off=bounds.off,
        leaks=np.array([math.exp(-leak * bounds.step * one) for one in seconds if leak]),
        **spacings,
    )
