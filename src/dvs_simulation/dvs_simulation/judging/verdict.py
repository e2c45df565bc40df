"""Did the run regulate, and did the estimate stay in its sector?"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario
from dvs_common.writing import write_text
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design_file import finite_or_null
from dvs_simulation.judging.measures import (
    ROUNDING,
    Judgement,
    error,
    largest,
    output_error,
    sector_ratio,
    settled_from,
    silent_below,
    unsettled,
)
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.run_budget import run_budget
from dvs_simulation.judging.trace import Trace
from dvs_simulation.judging.words import outcome_word, threshold_or_null, threshold_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Figures of one closed-loop run; the fields are the keys of `result.json`.

    Parameters
    ----------
    scenario
        Name of the scenario.
    regulated
        Whether `limsup_error` is below `tolerance`, and `limsup_output` below `output_tolerance`.
    interrupted
        Whether the run was stopped before its end.
    tolerance
        eps.
    final_error
        ``||W (x - x_d)||`` at the last sample, x_d being the equilibrium that is regulated to.
    limsup_error
        Largest ``||W (x - x_d)||`` over the last third of the run.
    limsup_output
        Largest ``|c'(x - x_d)|`` over the last third of the run.
    output_tolerance
        Tolerance of it; None for none.
    sector_ratio_max
        Largest ``|z - y| / (delta_z |y|)`` over all samples outside the dead band and all pixels
        that were used throughout.
    delta_z
        Bound of Lemma 4 on ``|z - y| / |y|``, the largest of all pixels.
    pixels
        r.
    pixels_masked
        Number of pixels that were not used, be it for a while: `pixel_mask`, and those that
        anchors have contradicted again and again.
    events
        Number of events.
    events_per_pixel
        ``events / r``.
    cycles
        Number of commands.
    samples_skipped
        Number of samples without a command: a plant on the wall clock skips what it is late for.
    cycles_per_second
        Commands a wall-clock second.
    wall_seconds
        Wall-clock time from the first sample with a command to the last command, s.
    simulated_seconds
        Length of the run in its own time, s.
    h
        Event threshold.
    h_star
        Published bound on h for the controller that ran; None where any threshold will do.
    h_certified
        Guaranteed bound on h for the loop that runs; None where any threshold will do.
    saturated_cycles
        Number of commands at `command_limit` or `command_rate_limit`.
    cycles_beyond_profile
        Number of samples at which `brightness_profile` was left, or its `profile_reach`.
    uncovered
        What acted on the run and is no part of the promise; empty for nothing.
    linear_plant
        Whether the suite's linear plant ran; of any other only the model is known.
    certified
        Whether h is within it and what became of the references, too (of a sensor in error the
        latter decides), and nothing was uncovered: it was promised.
    budget_used
        Largest ``h ln b + max w`` of the run, as the controller reported it.
    budget_allowed
        ``atanh(delta_certified)``; None where any error will do.
    certificate
        The least favourable state of the certificate during the run, in words.
    settling
        Whether the run may only not have settled yet: its start accounts for what is too much.
    slowest_pole
        Largest real part of a closed-loop pole, 1/s.
    """

    scenario: str
    regulated: bool
    interrupted: bool
    tolerance: float
    final_error: float
    limsup_error: float
    limsup_output: float
    output_tolerance: float | None
    sector_ratio_max: float
    delta_z: float
    pixels: int
    pixels_masked: int
    events: int
    events_per_pixel: float
    cycles: int
    samples_skipped: int
    cycles_per_second: float
    wall_seconds: float
    simulated_seconds: float
    h: float
    h_star: float | None
    h_certified: float | None
    saturated_cycles: int
    cycles_beyond_profile: int
    uncovered: str
    linear_plant: bool
    certified: bool
    budget_used: float
    budget_allowed: float | None
    certificate: str
    settling: bool
    slowest_pole: float

    @property
    def sector_held(self) -> bool:
        """Whether the bound of Lemma 4 held at every sample."""
        return self._judgement.sector_held

    @property
    def passed(self) -> bool:
        """Whether the run regulated and the sector bound held."""
        return self._judgement.passed

    @property
    def _judgement(self) -> Judgement:
        return Judgement(
            tolerance=self.tolerance,
            limsup_error=self.limsup_error,
            sector_ratio_max=self.sector_ratio_max,
            limsup_output=self.limsup_output,
            output_tolerance=math.inf if self.output_tolerance is None else self.output_tolerance,
        )

    @property
    def word(self) -> str:
        """What became of the run, in a few words."""
        word = outcome_word(
            regulated=self.regulated,
            slowest_pole=self.slowest_pole if self.settling else None,
            duration_s=self.simulated_seconds,
        )
        return word + (' (interrupted)' if self.interrupted else '')

    @property
    def promise(self) -> str:
        """Whether a promise stood for the run, and if not why."""
        if self.certified:
            return 'promised' if self.linear_plant else 'promised for the linear model'
        return f'nothing promised: {self.uncovered}' if self.uncovered else 'nothing promised'

    @property
    def certified_text(self) -> str:
        """h_certified in words."""
        return threshold_text(self.h_certified)

    @property
    def published_text(self) -> str:
        """h* in words."""
        return threshold_text(self.h_star)

    def save(self, path: Path) -> None:
        """Write `result.json`; null stands for what is not finite.

        Parameters
        ----------
        path
            File to write.
        """
        write_text(path, json.dumps(finite_or_null(dataclasses.asdict(self)), indent=2) + '\n')

    def __str__(self) -> str:
        """Return the verdict as a few readable lines."""
        held = 'held' if self.sector_held else 'VIOLATED'
        skipped = f', {self.samples_skipped} samples skipped' if self.samples_skipped else ''
        return '\n'.join(
            (
                f'{self.scenario}: {self.word}',
                f'  limsup ||x - x_d||   {self.limsup_error:.6f}   (last third; eps = '
                f'{self.tolerance:g})',
                f'  final  ||x - x_d||   {self.final_error:.6f}',
                *self._optional_lines(),
                f'  sector bound         {held}, worst |z - y| / (delta_z |y|) = '
                f'{self.sector_ratio_max:.6f}',
                f'  threshold            h = {self.h:g}, h_certified = {self.certified_text} '
                f'({self.promise}), h* = {self.published_text}',
                f'  certificate          {self.certificate}',
                f'  events               {self.events} ({self.events_per_pixel:.1f} a pixel, '
                f'{self.pixels} pixels{self._masked})',
                f'  speed                {self.cycles} cycles, {self.cycles_per_second:.0f} '
                f'cycles/s, {self.simulated_seconds / max(self.wall_seconds, 1e-9):.2f} x real '
                f'time{skipped}',
            )
        )

    @property
    def _masked(self) -> str:
        return f', {self.pixels_masked} of them masked' if self.pixels_masked else ''

    def _optional_lines(self) -> list[str]:
        lines = []
        if self.output_tolerance is not None:
            lines.append(
                f"  limsup |c'(x - x_d)| {self.limsup_output:.6f}   (output_tolerance = "
                f'{self.output_tolerance:g})'
            )
        if self.saturated_cycles:
            lines.append(
                f'  command              at its limit in {self.saturated_cycles} of '
                f'{self.cycles} cycles'
            )
        if self.cycles_beyond_profile:
            lines.append(
                f'  brightness profile   left, or its profile_reach, in '
                f'{self.cycles_beyond_profile} of {self.cycles} cycles'
            )
        return lines


def judge(
    trace: Trace,
    scenario: Scenario,
    *,
    name: str,
    promised: Promised,
    wall_seconds: float,
    interrupted: bool,
    bounds: ReferenceBounds | None = None,
    reported: Sequence[Budget] = (),
    unrecorded: int = 0,
) -> Verdict:
    """Verdict on a run.

    Parameters
    ----------
    trace
        Signals of the run.
    scenario
        Its parameters.
    name
        Name of the scenario.
    promised
        What the design that ran promises.
    wall_seconds
        Wall-clock time from the first sample with a command to the last command, s.
    interrupted
        Whether the run was stopped before its end.
    bounds
        Bounds m, M of q(0); those around the first luminosity for None.
    reported
        What the controller reported of its budget, in any order.
    unrecorded
        Samples that a recorder lost: not skipped by the plant.
    """
    bounds = bounds or scenario.reference_bounds(trace.luminosities[0])
    budget = run_budget(
        scenario,
        bounds,
        delta_certified=promised.delta_certified,
        h_certified=promised.h_certified,
        reported=reported,
    )
    worst, bound = budget.worst, budget.error_bounds
    held = scenario.equilibrium
    errors = error(trace.states, held, scenario.error_weights)
    outputs = output_error(trace.states, held, scenario.model.output_vector)
    settled = trace.times_s >= settled_from(trace.times_s[-1])
    saturated = _saturated(trace, scenario)
    beyond = int(np.count_nonzero(outputs > scenario.linearisation.reach))
    cycles, pixels = len(trace.times_s), trace.luminosities.shape[1]
    end = trace.times_s[-1]
    skipped = round(end / scenario.loop.sampling_period) + 1 - cycles - unrecorded
    uncovered = (
        'the command was at its limit' * (saturated > 0)
        or 'beyond profile_reach' * (beyond > 0)
        or 'samples without a command' * (skipped > 0)
        or promised.uncovered(scenario)
    )
    judgement = Judgement(
        tolerance=scenario.objective.tolerance,
        limsup_error=float(errors[settled].max()),
        sector_ratio_max=largest(sector_ratios(trace, scenario, bound)),
        output_tolerance=scenario.output_tolerance,
        limsup_output=float(outputs[settled].max()),
    )
    return Verdict(
        scenario=name,
        regulated=judgement.regulated,
        interrupted=interrupted,
        tolerance=judgement.tolerance,
        final_error=float(errors[-1]),
        limsup_error=judgement.limsup_error,
        limsup_output=judgement.limsup_output,
        output_tolerance=scenario.objective.output_tolerance or None,
        sector_ratio_max=judgement.sector_ratio_max,
        delta_z=float(bound.max(where=np.isfinite(bound), initial=0.0)),
        pixels=pixels,
        pixels_masked=budget.masked_pixels,
        events=len(trace.events),
        events_per_pixel=len(trace.events) / pixels,
        cycles=cycles,
        samples_skipped=skipped,
        cycles_per_second=(cycles - 1) / wall_seconds if wall_seconds > 0 else 0.0,
        wall_seconds=wall_seconds,
        simulated_seconds=float(end),
        h=scenario.sensor.event_threshold,
        h_star=threshold_or_null(promised.h_star),
        h_certified=threshold_or_null(promised.h_certified),
        saturated_cycles=saturated,
        cycles_beyond_profile=beyond,
        uncovered=uncovered,
        linear_plant=scenario.has_linear_plant,
        certified=budget.is_certified and not uncovered,
        budget_used=worst.used,
        budget_allowed=None if math.isinf(worst.allowed) else worst.allowed,
        certificate=str(worst),
        settling=not judgement.regulated
        and unsettled(
            judgement.limsup_error,
            judgement.tolerance,
            transient=promised.transient(
                trace.states[0] - held.state, settled_from(end) - trace.times_s[0], end
            ),
        ),
        slowest_pole=promised.slowest_pole,
    )


def _saturated(trace: Trace, scenario: Scenario) -> int:
    """Number of commands at a limit of their size or of their rate."""
    limited = np.any(np.abs(trace.commands) >= scenario.command_limit, axis=1)
    change = np.abs(np.diff(trace.commands, axis=0))
    most = np.diff(trace.times_s)[:, None] * scenario.command_rate_limit
    limited[1:] |= np.any(change >= most * (1 - ROUNDING), axis=1)
    return int(np.count_nonzero(limited))


def sector_ratios(trace: Trace, scenario: Scenario, error_bound: FloatArray) -> FloatArray:
    """``|z - y| / (delta_z |y|)`` at every sample and pixel, shape (K, r) (Lemma 4).

    Parameters
    ----------
    trace
        Signals of the run.
    scenario
        Its parameters.
    error_bound
        delta_z of every pixel, shape (r,); infinite for one that does not count.
    """
    return sector_ratio(
        trace.luminosities,
        trace.estimates,
        error_bound=error_bound,
        dead_band=silent_below(scenario),
    )
