"""Warnings for the user of a design before it runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, Timing
from dvs_hinf_controller.analysis.promise import Held
from dvs_hinf_controller.analysis.sampling import is_stable_at
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.design.running_bounds import RunningBounds
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem

# Methods whose speed the slack of the norm decides; `certified` chooses it for the period.
_SLACK_METHODS = ('unstructured', 'structured')
# A feedback that moves the state by a smaller share of the tolerance, and the luminosity by a
# smaller share of itself, counts as next to none.
_NO_FEEDBACK = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningLoop:
    """What a design is to run with, which its problem does not hold.

    Parameters
    ----------
    event_threshold
        h.
    command_limit
        Largest ``|u_o|`` of every input, shape (m,), infinite where there is none.
    command_rate_limit
        Largest change of ``u_o`` in a second, likewise.
    """

    event_threshold: float
    command_limit: FloatArray
    command_rate_limit: FloatArray

    @classmethod
    def of_scenario(cls, scenario: Scenario) -> RunningLoop:
        """The loop of a scenario.

        Parameters
        ----------
        scenario
            Checked parameters.
        """
        return cls(
            event_threshold=scenario.sensor.event_threshold,
            command_limit=scenario.command_limit,
            command_rate_limit=scenario.command_rate_limit,
        )


def design_warnings(design: Design, loop: RunningLoop) -> tuple[str, ...]:
    """Warnings for the user of a design before it runs, one sentence each.

    Parameters
    ----------
    design
        Controller and its figures.
    loop
        What it is to run with.
    """
    operation = design.problem.operation
    warnings = [*_of_the_threshold(design, loop.event_threshold), *_of_little_feedback(design)]
    if operation is None:
        return tuple(warnings)
    if not operation.sensor.is_covered:
        warnings.append(
            'not covered: threshold_uncertainty or leak_uncertainty without anchor_period: each '
            'event or second adds to the error of the estimate, and nothing takes it away'
        )
    if loop.event_threshold > design.figures.h_certified:
        warnings += _of_the_pace(design, operation)
    else:
        warnings += _of_the_limits(design, loop, operation)
    return tuple(warnings)


def _of_the_threshold(design: Design, h: float) -> Iterator[str]:
    figures = design.figures
    if h <= figures.h_certified:
        return
    published = ''
    if h > figures.h_star:
        published = f', nor published (it exceeds h* = {figures.h_star:.6g})'
    elif not figures.small_gain_ok:
        published = (
            ', nor does h* apply: the small-gain condition behind it, delta* ||Gw1||_inf < 1, '
            'does not hold'
        )
    if figures.h_certified > 0:
        certified = f'exceeds h_certified = {figures.h_certified:.6g}'
    else:
        certified = 'is not certified, and no other is'
    yield (
        f'event_threshold = {h:.6g} {certified}: nothing is promised for the loop that runs'
        f'{published}'
    )
    if figures.h_certified > 0:
        return
    operation = design.problem.operation
    if operation and operation.sensor.drifts and figures.delta_certified > 0:
        yield (
            'a run of this sensor is promised only as long as the certificate on /diagnostics is '
            '"certified now": h ln b + max w <= atanh(delta_certified)'
        )
    if design.method == 'certified':
        yield (
            'certified found no controller with a promise at any threshold and falls back to one '
            'that is stable without sampling and error'
        )


def _of_little_feedback(design: Design) -> Iterator[str]:
    figures, problem = design.figures, design.problem
    operation = problem.operation
    counted = operation and operation.model_uncertainty > 0 and np.any(operation.disturbance_bound)
    moved = figures.state_peak_gain * problem.mean_luminosity
    if counted or moved >= _NO_FEEDBACK * problem.tolerance:
        return
    if figures.output_peak_gain >= _NO_FEEDBACK:  # as that of every unstable plant
        return
    if figures.state_peak_gain == 0:
        what = 'no feedback at all, u is constant'
    else:
        share = moved / problem.tolerance
        what = f'next to no feedback, an error of 100 % moves the state by {share:.1g} tolerances'
    yield (
        f'{what}: nothing acts against an error of the plant or a disturbance, which '
        'model_uncertainty and disturbance_bound would count'
    )


def _of_the_pace(design: Design, operation: Operation) -> Iterator[str]:
    """Why the loop that runs may have no promise: it is too slow for the controller."""
    figures, period = design.figures, operation.sampling_period
    timing = Timing(period=period, latency=operation.latency)
    model, k = design.problem.model, design.controller
    # What has a promise at some threshold is stable.
    if figures.h_certified <= 0 and not (
        is_stable_at(model, k, period) and LiftedLoop(model, k, timing).is_stable
    ):
        late = f' and loop_latency = {operation.latency:g} s' if operation.latency else ''
        longest = figures.max_sampling_period
        bound = f' (stable up to {longest:.3g} s without latency)' if longest > 0 else ''
        yield (
            f'at sampling_period = {period:g} s{late} the loop is unstable without any error'
            f'{bound}; bandwidth_limit slows the controller down'
        )
    if design.method in _SLACK_METHODS and figures.fastest_pole * period > math.pi:
        yield (
            f'the fastest pole of the controller, {figures.fastest_pole:.4g} rad/s, lies beyond '
            f'pi / sampling_period = {math.pi / period:.4g} rad/s: a larger gamma_slack with a '
            'lower bandwidth_limit may slow it down'
        )


def _of_the_limits(design: Design, loop: RunningLoop, operation: Operation) -> Iterator[str]:
    """Where a command that a promise stands for may be held back."""
    if np.all(np.isinf(loop.command_limit)) and np.all(np.isinf(loop.command_rate_limit)):
        return
    found = RunningBounds.of(design, loop.event_threshold)
    for when, held in (
        ('in the limit', found.in_the_limit),
        ('from its start', found.from_its_start),
    ):
        if held is None:
            continue
        for name, reached, limit in _reached(held, loop, design.problem, operation):
            if np.any(reached > limit):
                bound = ', '.join(f'{v:.4g}' if v < math.inf else 'no bound' for v in reached)
                yield (
                    f'{name} = {limit.tolist()} may be reached {when}, where the bound is '
                    f'[{bound}]: no promise covers that'
                )
                return


def _reached(
    held: Held, loop: RunningLoop, problem: DesignProblem, operation: Operation
) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Bounds of the commands and of their rate of change, beside the limits."""
    yield 'command_limit', held.commands, loop.command_limit
    # From one end of the bound to the other within a period.
    swing = 2 * (held.commands - np.abs(problem.equilibrium.feedforward))
    yield 'command_rate_limit', swing / operation.sampling_period, loop.command_rate_limit


def luminosity_warnings(problem: DesignProblem, photoreceptor: str) -> tuple[str, ...]:
    """What is to be warned of where a pixel has no logarithm of its luminosity at the set-point.

    Parameters
    ----------
    problem
        Plant, set-point and pixels.
    photoreceptor
        ``signed_log`` sees luminosity of either sign, no real pixel does.
    """
    luminosity = problem.set_point_luminosity
    pixel = int(luminosity.argmin())
    if photoreceptor == 'signed_log' or luminosity[pixel] > 0:
        return ()
    return (
        f'pixel {pixel} has the luminosity {luminosity[pixel]:.6g} <= 0 at the set-point, which a '
        f'pixel with photoreceptor = {photoreceptor} does not see: no threshold is a promise',
    )
