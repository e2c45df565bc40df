"""What the controller logs when it starts: what was designed, and whether h is small enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.design.design_warnings import RunningLoop, design_warnings
from dvs_hinf_controller.design.figure_words import finite_or_any, threshold_words


@dataclass(frozen=True, slots=True, kw_only=True)
class StartUpReport:
    """Readable summary of a design at the running threshold.

    Parameters
    ----------
    text
        Block of lines for the log.
    warnings
        One sentence each.
    """

    text: str
    warnings: tuple[str, ...]


def start_up_report(design: Design, loop: RunningLoop, *, budget: Budget) -> StartUpReport:
    """Summary of `design` for a loop that runs at the given threshold.

    Parameters
    ----------
    design
        Controller and its figures.
    loop
        Threshold and limits of the loop that runs.
    budget
        What the loop uses at its start of the error that the design allows.
    """
    figures, problem, event_threshold = design.figures, design.problem, loop.event_threshold
    constants = sector(problem.bounds, event_threshold=event_threshold, log_base=problem.log_base)
    rows = (
        ('pixels r', f'{figures.pixels}'),
        ('event threshold h', f'{event_threshold:.6g}'),
        ('sector bound delta_z', f'{np.max(constants.error_bound):.6g}'),
        ('||Gw1(0)||', f'{figures.dc_gain_w1:.6g}'),
        ('||Gw2(0)||', f'{figures.dc_gain_w2:.6g}'),
        ('||Gw1||_inf', f'{figures.hinf_gain_w1:.6g}'),
        ('delta*', f'{figures.delta_star:.6g}'),
        ('h* (published)', threshold_words(figures.h_star, 6)),
        ('small gain, delta* ||Gw1||_inf < 1', 'yes' if figures.small_gain_ok else 'NO'),
        ('h_certified (guaranteed)', threshold_words(figures.h_certified, 6)),
        ('h ln b + max w', f'{budget.used:.6g}'),
        ('atanh(delta_certified)', f'{budget.allowed:.6g}'),
        ('certificate', str(budget).partition(':')[0]),
        ('controller order', f'{figures.controller_order}'),
        (
            'nominal loop stable up to a sampling_period of (no promise of eps)',
            f'{finite_or_any(figures.max_sampling_period * 1e3, 3)} ms',
        ),
    )
    width = max(len(name) for name, _ in rows)
    lines = [f'{design.method} controller, designed in {figures.seconds:.2f} s']
    lines += [f'  {name:<{width}}  {value}' for name, value in rows]
    lines += [
        '  the promise covers: ' + '; '.join(cost.part for cost in figures.costs),
        '  and not: noise events, lost messages, restarts, command_limit, the transient, '
        'a plant that is not linear (docs/promise.md)',
    ]
    return StartUpReport(text='\n'.join(lines), warnings=design_warnings(design, loop))
