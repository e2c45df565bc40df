"""Designs as text, one in full or several side by side, and as JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.margins import margins
from dvs_hinf_controller.analysis.promise import Held
from dvs_hinf_controller.design.design import Design, DesignFigures
from dvs_hinf_controller.design.design_file import finite_or_null
from dvs_hinf_controller.design.figure_words import finite_or_any, threshold_words
from dvs_hinf_controller.design.running_bounds import RunningBounds
from dvs_hinf_controller.problem import DesignProblem

# Less does not show in the digits that are printed.
_NO_COST = 5e-5


def report_text(designs: Sequence[Design], *, event_threshold: float) -> str:
    """Figures of one or more designs, a column each, and what they mean for the running h.

    Parameters
    ----------
    designs
        At least one, all for the same problem.
    event_threshold
        h that the loop is meant to run with.
    """
    problem = designs[0].problem
    rows = [['', *(design.method for design in designs)]]
    columns = [_cells(design, event_threshold) for design in designs]
    names = dict.fromkeys(name for column in columns for name in column)
    rows += [[name, *(column.get(name, '-') for column in columns)] for name in names]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    groups = problem.model.group_count
    head = (
        f'plant n = {problem.model.state_count}, m = {problem.model.input_count}; '
        f'{f"{groups} pixel groups; " if groups > 1 else ""}'
        f'pixels r = {problem.scene.pixel_count}; eps = {problem.tolerance:g}; '
        f'b = {problem.log_base:.6g}; h = {event_threshold:g}'
    )
    lines = [
        '  '.join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in rows
    ]
    return '\n'.join([head, '', *lines])


def _cells(design: Design, event_threshold: float) -> dict[str, str]:
    figures = design.figures
    mu = {
        'mu, upper bound': f'{figures.mu_upper:.5g}',
        'mu, lower bound': f'{figures.mu_lower:.5g}',
    }
    return {
        'gamma = sqrt(1 + ||c||^2) ||G||_inf': f'{figures.gamma:.5g}',
        **(mu if design.problem.model.group_count == 1 else {}),
        '||Gw1(0)||': f'{figures.dc_gain_w1:.5g}',
        '||Gw2(0)||': f'{figures.dc_gain_w2:.5g}',
        '||Gw1||_inf': f'{figures.hinf_gain_w1:.5g}',
        'delta* (published)': f'{figures.delta_star:.5g}',
        'h* (published)': threshold_words(figures.h_star),
        'small gain, delta* ||Gw1||_inf < 1': _word(figures.small_gain_ok),
        'peak gain w to ||x||, N_G': f'{figures.state_peak_gain:.5g}',
        "peak gain w to c'x, N_T": f'{figures.output_peak_gain:.5g}',
        **_cost_rows(figures),
        'delta certified': finite_or_any(figures.delta_certified, 5),
        'h certified (guaranteed)': threshold_words(figures.h_certified),
        'h <= h*': _word(event_threshold <= figures.h_star),
        'h <= h certified': _word(event_threshold <= figures.h_certified),
        **_margin_rows(design),
        'controller order': f'{figures.controller_order}',
        'fastest controller pole [rad/s]': f'{figures.fastest_pole:.4g}',
        'slowest closed-loop pole [1/s]': f'{figures.closed_loop_abscissa:.4g}',
        'nominal loop stable up to a period of [ms]': finite_or_any(
            figures.max_sampling_period * 1e3
        ),
        'synthesis time [s]': f'{figures.seconds:.3f}',
    }


def _cost_rows(figures: DesignFigures) -> dict[str, str]:
    """Threshold of the continuous loop, and what each further part of the promise costs."""
    rows = {'h certified, continuous loop': threshold_words(figures.h_certified_continuous)}
    for before, after in pairwise(figures.costs):
        rows[f'  {after.part}'] = _cost(before.threshold, after.threshold)
    return rows


def _cost(before: float, after: float) -> str:
    if before <= 0 and after <= 0:
        return '-'
    if after <= 0:
        return 'no promise is left'
    if abs(before - after) < _NO_COST or before == after:
        return 'costs nothing'
    if before == math.inf:
        return f'leaves {after:.4f}'
    return f'costs {before - after:.4f}' if before > after else f'gains {after - before:.4f}'


def _margin_rows(design: Design) -> dict[str, str]:
    if design.problem.model.group_count > 1:
        return {'margins': 'of one mean only'}
    if design.figures.state_peak_gain == 0:
        return {'gain margin, factors': 'no feedback'}
    found = margins(design.problem.model, design.controller)
    return {
        'gain margin, factors': f'{found.gain_down:.3g} ... {found.gain_up:.3g}',
        'phase margin [degrees]': finite_or_any(math.degrees(found.phase), 3),
        'delay margin [ms]': finite_or_any(found.delay * 1e3, 3),
    }


def promise_text(
    design: Design, event_threshold: float, *, command_limit: FloatArray | None = None
) -> str:
    """What the loop that runs stays within at one threshold: for ever, and from its start on.

    Parameters
    ----------
    design
        Design of a problem with an operation.
    event_threshold
        h.
    command_limit
        Largest ``|u_o|`` of every input, shape (m,); None for no limit.
    """
    problem = design.problem
    limit = np.full(problem.model.input_count, np.inf) if command_limit is None else command_limit
    found = RunningBounds.of(design, event_threshold)
    lines = [
        f'{design.method}, h = {event_threshold:g}:',
        f'  in the limit    {_bounds(found.in_the_limit, problem, limit)}',
    ]
    if found.from_its_start is not None:
        lines.append(f'  from its start  {_bounds(found.from_its_start, problem, limit)}')
        positive = 'every luminosity stays positive'
        if not found.luminosity_stays_positive:
            positive = f'not proven that {positive}'
        if problem.operation and math.isfinite(problem.operation.linearisation.reach):
            positive += ', and the profile within its reach'
        lines.append(f'  transient       {positive}')
    return '\n'.join(lines)


def _bounds(held: Held, problem: DesignProblem, limit: FloatArray) -> str:
    return f'{_held(held, problem)}, {_command(held, limit)}'


def _held(held: Held, problem: DesignProblem) -> str:
    error = '||x - x_d||' if problem.error_weights is None else '||W (x - x_d)||'
    output = f", |c'(x - x_d)| <= {_bound(held.output)}"
    return f'{error} <= {_bound(held.error)}{output if problem.output_tolerance < np.inf else ""}'


def _command(held: Held, limit: FloatArray) -> str:
    text = f'|u_o| <= [{", ".join(map(_bound, held.commands.tolist()))}]'
    if np.all(held.commands <= limit):
        return text
    return f'{text}: may reach command_limit = {limit.tolist()}, which no promise covers'


def _bound(value: float) -> str:
    return f'{value:.4g}' if math.isfinite(value) else 'no bound'


def _word(holds: bool) -> str:
    return 'yes' if holds else 'NO'


def as_json_object(design: Design) -> dict[str, Any]:
    """Method and figures as a flat object; null stands for infinity.

    `unlimited` names what is infinite, and the parts whose cost leaves any threshold: h_certified
    is, where any threshold will do. Where no threshold is fine enough it is 0 or negative, a
    number that compares with those of others.

    Parameters
    ----------
    design
        What to describe.
    """
    figures = dataclasses.asdict(design.figures)
    unlimited = [name for name, value in figures.items() if value == math.inf]
    unlimited += [cost.part for cost in design.figures.costs if cost.threshold == math.inf]
    figures = {name: _zero_for_none(value) for name, value in figures.items()}
    figures['costs'] = [
        {'part': cost.part, 'threshold': _zero_for_none(cost.threshold)}
        for cost in design.figures.costs
    ]
    return finite_or_null({'method': design.method, **figures, 'unlimited': unlimited})


def _zero_for_none(value: Any) -> Any:
    return 0.0 if value == -math.inf else value
