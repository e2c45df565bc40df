"""What the controller says when it starts: what was designed, and whether h is small enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.design.design import Design
from dvs_hinf_controller.problem import DesignProblem

# Methods whose speed the slack of the norm decides; `certified` chooses it for the period.
_SLACK_METHODS = ('unstructured', 'structured')


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


def start_up_report(
    design: Design, *, event_threshold: float, sampling_period: float, budget: Budget
) -> StartUpReport:
    """Summary of `design` for a loop that runs at the given threshold and period.

    Parameters
    ----------
    design
        Controller and its figures.
    event_threshold
        h of the running loop.
    sampling_period
        Period of commands, s.
    budget
        What the loop uses at its start of the error that the design allows.
    """
    figures, problem = design.figures, design.problem
    constants = sector(problem.bounds, event_threshold=event_threshold, log_base=problem.log_base)
    rows = (
        ('pixels r', f'{figures.pixels}'),
        ('event threshold h', f'{event_threshold:.6g}'),
        ('sector bound delta_z', f'{np.max(constants.error_bound):.6g}'),
        ('||Gw1(0)||', f'{figures.dc_gain_w1:.6g}'),
        ('||Gw2(0)||', f'{figures.dc_gain_w2:.6g}'),
        ('||Gw1||_inf', f'{figures.hinf_gain_w1:.6g}'),
        ('delta*', f'{figures.delta_star:.6g}'),
        ('h* (published)', f'{figures.h_star:.6g}'),
        ('small gain, delta* ||Gw1||_inf < 1', 'yes' if figures.small_gain_ok else 'NO'),
        ('h_certified (guaranteed)', f'{figures.h_certified:.6g}'),
        ('h ln b + max w', f'{budget.used:.6g}'),
        ('atanh(delta_certified)', f'{budget.allowed:.6g}'),
        ('certificate', str(budget).partition(':')[0]),
        ('controller order', f'{figures.controller_order}'),
        ('longest stable sampling period', f'{figures.max_sampling_period * 1e3:.3g} ms'),
    )
    width = max(len(name) for name, _ in rows)
    lines = [f'{design.method} controller, designed in {figures.seconds:.2f} s']
    lines += [f'  {name:<{width}}  {value}' for name, value in rows]
    lines += [
        '  the promise covers: ' + '; '.join(cost.part for cost in figures.costs),
        '  and not: noise events, lost messages, restarts, command_limit, the transient '
        '(docs/promise.md)',
    ]
    warnings = design_warnings(
        design, event_threshold=event_threshold, sampling_period=sampling_period
    )
    return StartUpReport(text='\n'.join(lines), warnings=warnings)


def design_warnings(
    design: Design, *, event_threshold: float, sampling_period: float
) -> tuple[str, ...]:
    """What a user of a design has to know before it runs, one sentence each.

    Parameters
    ----------
    design
        Controller and its figures.
    event_threshold
        h of the running loop.
    sampling_period
        Period of commands, s.
    """
    figures, warnings = design.figures, []
    operation = design.problem.operation
    if operation and not operation.sensor.is_covered:
        warnings.append(
            'not covered: threshold_uncertainty or leak_uncertainty without anchor_period: each '
            'event or second adds to the error of the estimate, and nothing takes it away'
        )
    if event_threshold > figures.h_certified:
        beyond = event_threshold > figures.h_star
        published = f', nor published (it exceeds h* = {figures.h_star:.6g})' if beyond else ''
        warnings.append(
            f'event_threshold = {event_threshold:.6g} exceeds h_certified = '
            f'{figures.h_certified:.6g}: nothing is promised for the loop that runs{published}'
        )
    if figures.state_peak_gain == 0:
        warnings.append(
            'no feedback at all, u is constant: nothing acts against an error of the plant '
            '(model_uncertainty) or a disturbance'
        )
    if not figures.small_gain_ok:
        warnings.append(
            'delta* ||Gw1||_inf >= 1: the small-gain condition behind h* does not hold, so h* '
            'does not apply; h_certified does'
        )
    if sampling_period > figures.max_sampling_period:
        warnings.append(
            f'at sampling_period = {sampling_period:g} s the loop is unstable, stable up to '
            f'{figures.max_sampling_period:.3g} s; lower bandwidth_limit'
        )
    if design.method in _SLACK_METHODS and figures.fastest_pole * sampling_period > math.pi:
        warnings.append(
            f'the fastest pole of the controller, {figures.fastest_pole:.4g} rad/s, lies beyond '
            f'pi / sampling_period = {math.pi / sampling_period:.4g} rad/s: a larger gamma_slack '
            'with a lower bandwidth_limit slows it down'
        )
    return tuple(warnings)


def darkness_warnings(problem: DesignProblem, photoreceptor: str) -> tuple[str, ...]:
    """What is to be said where a pixel has no logarithm of its luminosity at the set-point.

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
