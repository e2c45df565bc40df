"""The sampled loop with latency, jitter, disturbances and a plant in error, compiled.

Same scheme as the nodes' cores: log-linear levels between samples, events at their crossings, K
advanced exactly from event to event in modal coordinates, commands held. The plant moves by ticks,
a whole number of which make a period; latencies are whole ticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.reference_bounds import threshold_step
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_simulation.exact.compilation import jit

TICKS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class LateRun:
    """What acts on one run.

    Parameters
    ----------
    plant
        The true plant.
    deviation
        ``x(0) - x_d``, shape (n,).
    first_reference
        q(0), shape (r,), within the bounds of the problem.
    event_threshold
        h.
    latencies
        Latency of every command in ticks, shape (K,).
    disturbance
        Disturbance of the inputs at every tick, shape (K TICKS, m).
    greedy
        Row by which the sign of the disturbance follows the state instead, shape (m, n); zero for
        the given signs.
    """

    plant: PlantModel
    deviation: FloatArray
    first_reference: FloatArray
    event_threshold: float
    latencies: NDArray[np.int64]
    disturbance: FloatArray
    greedy: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LatePath:
    """What a run leaves.

    Parameters
    ----------
    deviations
        ``x - x_d`` at all ticks, shape (K TICKS, n); NaN from a luminosity
        that is not positive on.
    counts
        Sum of the polarities of every pixel up to every sample, shape (K, r); those from the
        last period before a luminosity that is not positive on are zero.
    """

    deviations: FloatArray
    counts: NDArray[np.int64]


def run_late(problem: DesignProblem, controller: LinearController, run: LateRun) -> LatePath:
    """Run the loop.

    Parameters
    ----------
    problem
        What the controller was designed for, with an operation.
    controller
        K, strictly proper, with distinct poles.
    run
        What acts on it.
    """
    assert problem.operation is not None
    n, m = problem.model.state_count, problem.model.input_count
    tick = problem.operation.sampling_period / TICKS
    held = problem.equilibrium
    # The true plant is not at rest at the set-point: a constant drive.
    drift = run.plant.state_matrix @ held.state + run.plant.input_matrix @ held.feedforward
    flow = np.zeros((n + m + 1,) * 2)
    flow[:n] = np.column_stack([run.plant.state_matrix, run.plant.input_matrix, drift])
    step = scipy.linalg.expm(flow * tick)[:n]
    poles, vectors = np.linalg.eig(controller.state_matrix)
    constants = sector(
        problem.bounds, event_threshold=run.event_threshold, log_base=problem.log_base
    )
    path = np.full((run.latencies.size * TICKS, n), math.nan)
    counts = np.zeros((run.latencies.size, problem.scene.pixel_count), np.int64)
    _run(
        path,
        counts,
        run.deviation.astype(np.float64),
        step,
        problem.model.gradient,
        problem.set_point_luminosity,
        poles.astype(np.complex128),
        np.linalg.solve(vectors, controller.input_vector.astype(np.complex128)),
        (controller.output_matrix @ vectors).astype(np.complex128),
        tick * TICKS,
        threshold_step(run.event_threshold, problem.log_base),
        np.log(run.first_reference),
        constants.initial_estimate,
        run.latencies,
        run.disturbance,
        run.greedy,
    )
    return LatePath(deviations=path, counts=counts)


@jit
def _run(
    path: FloatArray,
    counted: NDArray[np.int64],
    x: FloatArray,
    step: FloatArray,
    c: FloatArray,
    light: FloatArray,
    poles: NDArray[np.complex128],
    into: NDArray[np.complex128],
    out: NDArray[np.complex128],
    period: float,
    h: float,
    first: FloatArray,
    scale: FloatArray,
    late: NDArray[np.int64],
    d: FloatArray,
    greedy: FloatArray,
) -> None:
    n, m, r, k = x.size, out.shape[0], light.size, poles.size
    ticks = path.shape[0] // late.size
    counts = np.zeros(r)
    q = np.zeros(k, np.complex128)
    commands = np.zeros((late.size + 1, m))
    drive = np.zeros(n + m + 1)
    drive[n + m] = 1.0
    target = light.mean()
    error = (scale * np.exp(counts * h)).mean() - target
    applied = -1
    follows = np.array([np.any(row != 0.0) for row in greedy])
    for sample in range(late.size):
        for i in range(r):
            counted[sample, i] = int(counts[i])
        for j in range(m):
            commands[sample, j] = (out[j] * q).sum().real
        level = np.log(light + c @ x)
        for tick in range(ticks):
            now = sample * ticks + tick
            while applied < sample and (applied + 1) * ticks + late[applied + 1] <= now:
                applied += 1
            for i in range(n):
                path[now, i] = drive[i] = x[i]
            for j in range(m):
                push = d[now, j]
                if follows[j]:
                    along = 0.0
                    for i in range(n):
                        along += greedy[j, i] * x[i]
                    push = abs(push) if along > 0 else -abs(push)
                drive[n + j] = push + (commands[applied, j] if applied >= 0 else 0.0)
            for i in range(n):
                total = 0.0
                for j in range(n + m + 1):
                    total += step[i, j] * drive[j]
                x[i] = total
        luminosity = light + c @ x
        if luminosity.min() <= 0.0 or not np.isfinite(luminosity.max()):
            return
        slope = (np.log(luminosity) - level) / period
        at = 0.0
        while True:
            when, which, sign = period, -1, 0.0
            for i in range(r):
                if slope[i] == 0.0:
                    continue
                way = 1.0 if slope[i] > 0 else -1.0
                crossing = (first[i] + (counts[i] + way) * h - level[i]) / slope[i]
                if crossing <= when:
                    when, which, sign = max(crossing, at), i, way
            length = when - at
            for i in range(k):
                grown = np.exp(poles[i] * length)
                q[i] = grown * q[i] + (grown - 1.0) / poles[i] * into[i] * error
            at = when
            if which < 0:
                break
            counts[which] += sign
            error = (scale * np.exp(counts * h)).mean() - target
