"""What a controller promises for its problem, and what each part of the promise costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.largest_threshold import (
    HeldBySectors,
    held_at,
    largest_threshold,
    largest_uncertainty,
)
from dvs_hinf_controller.analysis.peak_gain import ChannelGains
from dvs_hinf_controller.analysis.plant_list import held_with_all
from dvs_hinf_controller.analysis.promise import Continuous, Held
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty

# Of a start along its direction: where the search for the farthest one ends.
_FARTHEST, _BISECTIONS = 2.0**30, 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What one part of the promise costs of the threshold.

    Parameters
    ----------
    part
        What was added to the promise.
    threshold
        Certified threshold with it and all parts before it.
    """

    part: str
    threshold: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Certification:
    """Thresholds of a controller.

    Parameters
    ----------
    h_continuous
        For the continuous loop with nothing but the error of the estimate.
    h_certified
        For all parts of the promise together.
    delta_certified
        The same as a common relative error of all estimates; 0 if the tolerance fails at any.
    costs
        The parts, in the order in which they were added; the first is the continuous loop.
    """

    h_continuous: float
    h_certified: float
    delta_certified: float
    costs: tuple[Cost, ...]


def certify(
    problem: DesignProblem, controller: LinearController, gains: ChannelGains
) -> Certification:
    """Certified thresholds of a controller.

    Parameters
    ----------
    problem
        What is asked.
    controller
        K.
    gains
        Peak gains of the continuous loop.
    """
    held: HeldBySectors = Continuous(problem, gains).held
    continuous = certified = largest_threshold(problem.continuous, held)
    costs = [Cost(part='continuous loop', threshold=continuous)]
    for part, operation in _parts(problem.operation):
        held = held_with_all(problem, controller, operation)
        certified = largest_threshold(problem.operated(operation), held)
        costs.append(Cost(part=part, threshold=certified))
    for part, operation in _width_parts(problem.operation):
        certified = largest_threshold(problem.operated(operation), held)
        costs.append(Cost(part=part, threshold=certified))
    return Certification(
        h_continuous=continuous,
        h_certified=certified,
        delta_certified=largest_uncertainty(problem, held),
        costs=tuple(costs),
    )


def held_from(
    problem: DesignProblem,
    controller: LinearController,
    event_threshold: float,
    *,
    start: FloatArray | None = None,
) -> Held:
    """Bounds of the loop that runs at one threshold.

    Parameters
    ----------
    problem
        What is asked, with an operation.
    controller
        K.
    event_threshold
        h.
    start
        ``x - x_d`` at the start, for bounds that hold from then on; None for the limit.
    """
    return held_at(problem, _running(problem, controller), event_threshold, start=start)


def farthest_start(
    problem: DesignProblem,
    controller: LinearController,
    event_threshold: float,
    direction: FloatArray,
) -> FloatArray:
    """Farthest start along a direction from which every luminosity is promised positive.

    From nearer ones of this direction it is promised, too: the bounds grow with the start.

    Parameters
    ----------
    problem
        What is asked, with an operation.
    controller
        K.
    event_threshold
        h.
    direction
        Multiple of ``x - x_d`` at the start, shape (n,).

    Returns
    -------
    ndarray
        ``x - x_d``; 0 where nothing is promised at this threshold.
    """
    held = _running(problem, controller)

    def is_promised(factor: float) -> bool:
        found = held_at(problem, held, event_threshold, start=factor * direction)
        return math.isfinite(found.error)

    inside, outside = 0.0, 1.0
    while outside < _FARTHEST and is_promised(outside):
        inside, outside = outside, 2 * outside
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_promised(middle) else (inside, middle)
    return inside * direction


def _running(problem: DesignProblem, controller: LinearController) -> HeldBySectors:
    if problem.operation is None:
        raise ValueError('a problem without an operation has no running loop')
    return held_with_all(problem, controller, problem.operation)


def _parts(operation: Operation | None) -> list[tuple[str, Operation]]:
    """The operation built up part by part, those that it lacks left out."""
    if operation is None:
        return []
    bare = Operation(sampling_period=operation.sampling_period, interpolates=False)
    parts = [(f'commands held for {_time(operation.sampling_period)}', bare)]
    steps: tuple[tuple[str, str, object, bool], ...] = (
        (
            f'latency {_time(operation.latency)}',
            'latency',
            operation.latency,
            operation.latency > 0,
        ),
        (
            f'jitter {_time(operation.latency_jitter)}',
            'latency_jitter',
            operation.latency_jitter,
            operation.latency_jitter > 0,
        ),
        ('camera interpolates samples', 'interpolates', True, operation.interpolates),
        (
            'disturbance of the inputs',
            'disturbance_bound',
            operation.disturbance_bound,
            bool(np.any(operation.disturbance_bound)),
        ),
        (
            'constant load',
            'constant_load',
            operation.constant_load,
            bool(np.any(operation.constant_load)),
        ),
        (
            f'output disturbance {operation.output_disturbance:g}',
            'output_disturbance',
            operation.output_disturbance,
            operation.output_disturbance > 0,
        ),
        (
            f'{len(operation.further_plants)} further plants',
            'further_plants',
            operation.further_plants,
            bool(operation.further_plants),
        ),
        (
            str(operation.linearisation),
            'linearisation',
            operation.linearisation,
            math.isfinite(operation.linearisation.reach),
        ),
        (
            f'events late by up to {_time(operation.sensor.latency)}',
            'sensor',
            SensorUncertainty(latency=operation.sensor.latency),
            operation.sensor.latency > 0,
        ),
        (
            f'{100 * operation.model_uncertainty:g} % error of A and B',
            'model_uncertainty',
            operation.model_uncertainty,
            operation.model_uncertainty > 0,
        ),
    )
    for name, field, value, is_there in steps:
        if is_there:
            parts.append((name, replace(parts[-1][1], **{field: value})))  # type: ignore[arg-type]
    return parts


def _width_parts(operation: Operation | None) -> list[tuple[str, Operation]]:
    """What moves the intervals of the references while the loop runs, part by part."""
    if operation is None:
        return []
    sensor, parts = operation.sensor, []
    given = SensorUncertainty(latency=sensor.latency)
    alone = '' if sensor.is_covered else 'NOT COVERED without anchors (anchor_period): '
    steps: tuple[tuple[str, dict[str, float], bool], ...] = (
        (
            f'anchors within {100 * sensor.anchor:g} % every {_time(sensor.anchor_period)}',
            {'anchor': sensor.anchor, 'anchor_period': sensor.anchor_period},
            sensor.anchor_period > 0,
        ),
        (
            f'{alone}threshold uncertainty {_thresholds(sensor)}',
            {'threshold_on': sensor.threshold_on, 'threshold_off': sensor.threshold_off},
            sensor.threshold > 0,
        ),
        (f'{alone}leak up to {sensor.leak:g}/s', {'leak': sensor.leak}, sensor.leak > 0),
    )
    for name, values, is_there in steps:
        if is_there:
            given = replace(given, **values)
            parts.append((name, replace(operation, sensor=given)))
    return parts


def _thresholds(sensor: SensorUncertainty) -> str:
    on, off = (f'{100 * error:g} %' for error in (sensor.threshold_on, sensor.threshold_off))
    return on if on == off else f'{on} ON, {off} OFF'


def _time(seconds: float) -> str:
    return f'{seconds * 1e3:g} ms' if math.isfinite(seconds) else 'for ever'
