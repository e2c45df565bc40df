"""What can be judged of a run whose plant publishes no state."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import parse_command, parse_state
from dvs_common.writing import write_text
from dvs_event_camera.streams.image_source import parse_luminosity
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.design.design_file import finite_or_null
from dvs_simulation.judging.measures import (
    Judgement,
    largest,
    sector_ratio,
    settled_from,
    silent_below,
)
from dvs_simulation.judging.run_budget import run_budget
from dvs_simulation.judging.trace import IncompleteTraceError, Messages


@dataclass(frozen=True, slots=True, kw_only=True)
class Unjudged:
    """Figures of a run of which ``||x - x_d||`` is not known; the keys of its `result.json`.

    Parameters
    ----------
    scenario
        Name of the scenario.
    interrupted
        Whether the run was stopped before its end.
    limsup_luminosity
        Largest ``|y_i - y_i(x_d)|`` of a pixel over the last third of the run, which is
        ``|c'(x - x_d)|`` where the light is affine in the state.
    sector_ratio_max
        Largest ``|z - y| / (delta_z |y|)`` over all pixels and samples.
    cycles
        Number of commands.
    simulated_seconds
        Length of the run in its own time, s.
    regulated
        Always None: not known.
    """

    scenario: str
    interrupted: bool
    limsup_luminosity: float
    sector_ratio_max: float
    cycles: int
    simulated_seconds: float
    regulated: None = None

    @property
    def passed(self) -> bool:
        """Whether the run regulated: nothing shows it."""
        return False

    def save(self, path: Path) -> None:
        """Write `result.json`; null stands for what is not finite.

        Parameters
        ----------
        path
            File to write.
        """
        write_text(path, json.dumps(finite_or_null(dataclasses.asdict(self)), indent=2) + '\n')

    def __str__(self) -> str:
        """Return what is known as a few readable lines."""
        held = Judgement(
            tolerance=0.0, limsup_error=0.0, sector_ratio_max=self.sector_ratio_max
        ).sector_held
        return '\n'.join(
            (
                f'{self.scenario}: no verdict: the plant publishes no state, so that '
                '||x - x_d|| cannot be judged',
                f'  limsup |y - y_d|     {self.limsup_luminosity:.6f}   (last third, any pixel)',
                f'  sector bound         {"held" if held else "VIOLATED"}, worst '
                f'|z - y| / (delta_z |y|) = {self.sector_ratio_max:.6f}',
                f'  length               {self.cycles} cycles, {self.simulated_seconds:g} s'
                f'{" (interrupted)" if self.interrupted else ""}',
            )
        )


def without_states(
    messages: Messages,
    scenario: Scenario,
    *,
    name: str,
    delta_certified: float,
    interrupted: bool,
    reported: Sequence[Budget] = (),
) -> Unjudged:
    """Figures of a run from its luminosities, estimates and commands.

    Parameters
    ----------
    messages
        CDR bytes by topic.
    scenario
        Its parameters.
    name
        Name of the scenario.
    delta_certified
        Relative error of the estimate up to which the tolerance is guaranteed.
    interrupted
        Whether the run was stopped before its end.
    reported
        What the controller reported of its budget, in any order.

    Raises
    ------
    IncompleteTraceError
        If no sample has luminosity, estimate and command.
    """
    frames = {f.stamp_ns: f.pixels for f in map(parse_luminosity, messages[topics.LUMINOSITY])}
    estimates = {v.stamp_ns: v.values for v in map(parse_state, messages[topics.ESTIMATE])}
    commands = {parse_command(message).stamp_ns for message in messages[topics.COMMAND]}
    stamps = sorted(commands & frames.keys() & estimates.keys())
    if not stamps:
        raise IncompleteTraceError('no sample has luminosity, estimate and command')
    y = np.array([frames[stamp].reshape(-1) for stamp in stamps], dtype=float)
    z = np.array([estimates[stamp] for stamp in stamps])
    times_s = as_seconds(np.array(stamps) - stamps[0])
    budget = run_budget(
        scenario,
        scenario.reference_bounds(y[0]),
        delta_certified=delta_certified,
        h_certified=math.inf,
        reported=reported,
    )
    wanted = scenario.scene.luminosity(scenario.model, scenario.equilibrium.state)
    settled = times_s >= settled_from(times_s[-1])
    ratios = sector_ratio(y, z, error_bound=budget.error_bounds, dead_band=silent_below(scenario))
    return Unjudged(
        scenario=name,
        interrupted=interrupted,
        limsup_luminosity=float(np.abs(y[settled] - wanted).max()),
        sector_ratio_max=largest(ratios),
        cycles=len(stamps),
        simulated_seconds=float(times_s[-1]),
    )
