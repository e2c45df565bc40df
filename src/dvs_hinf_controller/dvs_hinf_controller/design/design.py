"""From a problem to a controller with every figure of what it promises."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.analysis.peak_gain import channel_gains
from dvs_hinf_controller.analysis.published_norms import published_norms
from dvs_hinf_controller.analysis.sampling import max_sampling_period
from dvs_hinf_controller.analysis.thresholds import (
    event_threshold,
    published_uncertainty,
    small_gain_holds,
)
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.certification import Cost, certify
from dvs_hinf_controller.design.design_file import (
    controller_fields,
    controller_of,
    read_design_file,
    write_design_file,
)
from dvs_hinf_controller.design.kept_designs import kept
from dvs_hinf_controller.problem import DesignProblem, unmasked
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.integral_action import (
    integrated_problem,
    with_integrators,
)
from dvs_hinf_controller.synthesis.methods import METHODS, synthesis_method
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignFigures:
    """Every figure of a design, all measured on the controller that is returned.

    Parameters
    ----------
    pixels
        Number of pixels r.
    gamma
        ``sqrt(1 + ||c||^2) ||G||_inf``, the paper's unstructured norm; an upper bound.
    mu_upper
        Bound of ``mu = sup_w (|T| + ||G||)`` for all frequencies; not a number where there are
        several pixel groups.
    mu_lower
        Inverse size of a perturbation that makes the loop singular; likewise.
    dc_gain_w1
        ``||Gw1(0)||``.
    dc_gain_w2
        ``||W Gw2(0)||``.
    hinf_gain_w1
        ``||Gw1||_inf``, an upper bound.
    delta_star
        delta* (paper, Theorem 1).
    h_star
        h* (paper, Theorem 2), in logarithms to the problem's base.
    small_gain_ok
        Whether ``delta* ||Gw1||_inf < 1``.
    state_peak_gain
        N_G, peak gain from w to ``||W x||``, an upper bound; from those of all pixel groups
        together.
    output_peak_gain
        N_T, peak gain from w to ``c'x``, an upper bound; the largest of all groups, from those
        of all together.
    delta_certified
        Relative error of the estimate up to which ``limsup ||x|| <= eps`` is guaranteed for the
        loop that runs.
    h_certified
        Event threshold up to which it is guaranteed, for all parts of the promise together
        (docs/promise.md).
    h_certified_continuous
        The same for the continuous loop with nothing but the error of the estimate.
    costs
        Threshold after each part of the promise, added one after the other.
    controller_order
        States of K.
    fastest_pole
        Largest magnitude of a pole of K, rad/s.
    closed_loop_abscissa
        Largest real part of a closed-loop pole, 1/s.
    max_sampling_period
        Longest period up to which the sampled loop is stable without latency and without any
        error of the estimate, s. No promise of eps: that is h_certified, at `sampling_period`.
    seconds
        Time that the synthesis took, s.
    """

    pixels: int
    gamma: float
    mu_upper: float
    mu_lower: float
    dc_gain_w1: float
    dc_gain_w2: float
    hinf_gain_w1: float
    delta_star: float
    h_star: float
    small_gain_ok: bool
    state_peak_gain: float
    output_peak_gain: float
    delta_certified: float
    h_certified: float
    h_certified_continuous: float
    costs: tuple[Cost, ...]
    controller_order: int
    fastest_pole: float
    closed_loop_abscissa: float
    max_sampling_period: float
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """A controller, the problem that it answers and its figures.

    Parameters
    ----------
    method
        Name of the method that found it.
    problem
        What was asked, with all pixels.
    controller
        K on the mean of zbar.
    figures
        What it promises with the mean over the pixels that are not masked.
    """

    method: str
    problem: DesignProblem
    controller: LinearController
    figures: DesignFigures

    def without_pixels(self, masked: Sequence[int]) -> Design:
        """The same design for the pixels that are used: those of its figures.

        Parameters
        ----------
        masked
            Row-major numbers of the others.
        """
        used = unmasked(self.problem.scene.pixel_count, masked)
        return dataclasses.replace(self, problem=self.problem.of_pixels(used))


def design_controller(
    problem: DesignProblem, *, method: str = 'structured', options: DesignOptions | None = None
) -> Design:
    """Synthesise a controller and measure it.

    Parameters
    ----------
    problem
        Plant, set-point, pixels, tolerance.
    method
        Key of `METHODS`.
    options
        Trade between optimality and speed.

    Raises
    ------
    ParameterError
        If there is no such method.
    SynthesisError
        If no controller exists; names the assumption that fails.
    """
    strategy = synthesis_method(method)
    start = time.perf_counter()
    options = options or DesignOptions()
    if options.integral_action:
        found = strategy.synthesize(integrated_problem(problem), options)
        controller = with_integrators(found)
    else:
        controller = strategy.synthesize(problem, options)
    seconds = time.perf_counter() - start
    return Design(
        method=method,
        problem=problem,
        controller=controller,
        figures=measure(problem, controller, seconds=seconds),
    )


def design_from_scenario(scenario: Scenario) -> Design:
    """Controller that a scenario asks for: found once, and kept on disk (`kept_designs`).

    Parameters
    ----------
    scenario
        Checked parameters.

    Raises
    ------
    SuiteError
        If parameters do not fit together, no controller exists, or design_file holds a design for
        another problem.
    """
    problem = DesignProblem.from_scenario(scenario)
    masked = scenario.uncertainty.pixel_mask
    if scenario.controller.method == 'file':
        if not scenario.controller.design_file:
            raise ParameterError('design_file', '', 'must be given with method: file')
        return load_design(scenario.controller.design_file, problem, masked=masked)
    try:
        design = _found_once(
            problem.of_pixels(unmasked(problem.scene.pixel_count, masked)),
            scenario.controller.method,
            DesignOptions.from_scenario(scenario),
        )
        return dataclasses.replace(design, problem=problem)
    except np.linalg.LinAlgError as error:
        raise SynthesisError(
            Assumption.RANK, f'{error}; does every input act, and are the numbers in proportion?'
        ) from None


def _found_once(problem: DesignProblem, method: str, options: DesignOptions) -> Design:
    """Return the design of a former call, of another process too, or find it."""
    if method not in METHODS:
        # The code of a user's own method is not known here.
        return design_controller(problem, method=method, options=options)

    def find() -> dict[str, Any]:
        design = design_controller(problem, method=method, options=options)
        return {
            'controller': controller_fields(design.controller),
            'figures': dataclasses.asdict(design.figures),
        }

    found = kept((problem, method, options), find)
    figures = found['figures']
    return Design(
        method=method,
        problem=problem,
        controller=controller_of(found['controller']),
        figures=DesignFigures(
            **{**figures, 'costs': tuple(Cost(**cost) for cost in figures['costs'])}
        ),
    )


def load_design(path: str | Path, problem: DesignProblem, *, masked: Sequence[int] = ()) -> Design:
    """Design of a file, its figures measured anew for `problem`.

    Tolerance, base and reference bounds may differ from those that it was made for; the figures
    tell what it is worth then.

    Parameters
    ----------
    path
        File written by `save_design`.
    problem
        Problem that it must have been made for.
    masked
        Pixels that are not used; the figures are those of the others.

    Raises
    ------
    ParameterError
        If the file is no design, or one for another plant, set-point or pixel set; names which.
    SynthesisError
        If the stored controller does not stabilize the plant.
    """
    stored = read_design_file(path)
    stored.require_made_for(problem)
    return Design(
        method=stored.method,
        problem=problem,
        controller=stored.controller,
        figures=measure(
            problem.of_pixels(unmasked(problem.scene.pixel_count, masked)),
            stored.controller,
            seconds=stored.seconds,
        ),
    )


def save_design(design: Design, path: str | Path) -> None:
    """Write a design as JSON.

    Parameters
    ----------
    design
        What to write.
    path
        File to write.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    write_design_file(
        path,
        method=design.method,
        problem=design.problem,
        controller=design.controller,
        figures=dataclasses.asdict(design.figures),
    )


def measure(
    problem: DesignProblem, controller: LinearController, *, seconds: float = 0.0
) -> DesignFigures:
    """Figures of any controller for `problem`, by methods that its synthesis did not use.

    Parameters
    ----------
    problem
        What is asked.
    controller
        K on the mean of zbar.
    seconds
        Time that its synthesis took, to be passed on.

    Raises
    ------
    SynthesisError
        If the closed loop is not stable, or settles too slowly.
    """
    g = state_response(problem.model, controller)
    abscissa = g.abscissa
    if not abscissa < 0:
        raise SynthesisError(
            Assumption.CONFIRMATION, f'a closed-loop pole has real part {abscissa:.3g}'
        )
    if not abscissa <= -problem.least_decay:
        raise SynthesisError(
            Assumption.CONFIRMATION,
            f'a closed-loop pole has real part {abscissa:.3g}, and settling_time = '
            f'{problem.settling_time:g} s needs {-problem.least_decay:.3g}',
        )
    norms = published_norms(problem, g)
    delta_star = published_uncertainty(
        problem, dc_gain_w1=norms.dc_gain_w1, dc_gain_w2=norms.dc_gain_w2
    )
    gains = channel_gains(g, problem.model.gradients, weights=problem.error_weights)
    certification, peak = certify(problem, controller, gains), gains.together
    return DesignFigures(
        pixels=problem.scene.pixel_count,
        mu_upper=norms.mu_upper,
        mu_lower=norms.mu_lower,
        state_peak_gain=peak.state,
        output_peak_gain=peak.output,
        delta_certified=certification.delta_certified,
        h_certified=certification.h_certified,
        h_certified_continuous=certification.h_continuous,
        costs=certification.costs,
        gamma=norms.gamma,
        dc_gain_w1=norms.dc_gain_w1,
        dc_gain_w2=norms.dc_gain_w2,
        hinf_gain_w1=norms.hinf_gain_w1,
        delta_star=delta_star,
        h_star=event_threshold(problem, delta_star),
        small_gain_ok=small_gain_holds(delta_star, norms.hinf_gain_w1),
        controller_order=controller.order,
        fastest_pole=float(np.max(np.abs(np.linalg.eigvals(controller.state_matrix)), initial=0)),
        closed_loop_abscissa=abscissa,
        max_sampling_period=max_sampling_period(problem.model, controller),
        seconds=seconds,
    )
