"""The runs behind the figures: designs, trajectories, the counterexample, the positivity check."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.sector import sector
from dvs_hinf_controller.analysis.thresholds import event_threshold
from dvs_hinf_controller.design.design import Design, DesignFigures, design_controller, measure
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_simulation.exact import ClosedLoop, Trajectory, simulate
from dvs_simulation.exact.signals import luminosities, sector_ratios
from dvs_simulation.judging.measures import error, largest
from dvs_simulation.paper.counterexample import misled_controller
from dvs_simulation.paper.published import Example, platform_scenario, scenario

RUN_THRESHOLD = 0.149
RUN_DURATION_S = 6.0
COUNTEREXAMPLE_THRESHOLDS = (0.10, 0.15)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """A design and one exact run with it.

    Parameters
    ----------
    design
        Controller and its figures.
    loop
        What ran.
    run
        What came out.
    """

    design: Design
    loop: ClosedLoop
    run: Trajectory

    @property
    def error(self) -> FloatArray:
        """``||x - x_d||`` at the samples."""
        return error(self.run.states, self.loop.equilibrium)

    @property
    def luminosity(self) -> FloatArray:
        """y_i at the samples, shape (k, r)."""
        return luminosities(self.loop, self.run.states)

    @property
    def sector_ratio(self) -> float:
        """Largest ``|z - y| / (delta_z |y|)`` at the samples outside the dead band."""
        return largest(sector_ratios(self.loop, self.run))


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterexample:
    """The loop that the theorems allow and that leaves its tolerance.

    Parameters
    ----------
    problem
        The mirror example with one pixel.
    figures
        What its controller promises.
    h_allowed
        Largest h by Theorems 1 and 2 with the true small-gain condition added.
    experiments
        A run at each of `COUNTEREXAMPLE_THRESHOLDS`.
    sweep_thresholds
        h of `sweep_limsup`.
    sweep_limsup
        limsup of the error there.
    """

    problem: DesignProblem
    figures: DesignFigures
    h_allowed: float
    experiments: tuple[Experiment, ...]
    sweep_thresholds: FloatArray
    sweep_limsup: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdCurve:
    """Error against h for one design of the mirror example.

    Parameters
    ----------
    design
        The design.
    thresholds
        h, shape (k,).
    limsup
        Simulated limsup of the error, shape (k,).
    bound
        Guaranteed limsup, shape (k,); infinite where there is none.
    """

    design: Design
    thresholds: FloatArray
    limsup: FloatArray
    bound: FloatArray


def run_example(example: Example, pixels: int, method: str) -> Experiment:
    """Design for the paper's example (or its mirror image) and run it at h = 0.149.

    Parameters
    ----------
    example
        `paper` or `mirror`.
    pixels
        r.
    method
        How the controller is found.
    """
    plain = scenario(example, pixels, event_threshold=RUN_THRESHOLD)
    design = design_controller(DesignProblem.from_scenario(plain).continuous, method=method)
    return _experiment(design, ClosedLoop.from_scenario(plain, design.controller))


def run_platform() -> Experiment:
    """The appendix' camera on its platform, with a structured controller."""
    plain = platform_scenario()
    design = design_controller(DesignProblem.from_scenario(plain).continuous, method='structured')
    return _experiment(design, ClosedLoop.from_scenario(plain, design.controller))


def run_counterexample() -> Counterexample:
    """The counterexample at two thresholds, and limsup over many."""
    plain = scenario('mirror', 1)
    problem = DesignProblem.from_scenario(plain).continuous
    controller = misled_controller(problem.model)
    figures = measure(problem, controller)
    design = Design(method='misled', problem=problem, controller=controller, figures=figures)
    loop = ClosedLoop.from_scenario(plain, controller)
    allowed = min(figures.delta_star, 1 / figures.hinf_gain_w1)
    thresholds = np.linspace(0.02, 0.5, 97)
    return Counterexample(
        problem=problem,
        figures=figures,
        h_allowed=event_threshold(problem, allowed),
        experiments=tuple(
            _experiment(design, loop.with_threshold(h), duration=30.0)
            for h in COUNTEREXAMPLE_THRESHOLDS
        ),
        sweep_thresholds=thresholds,
        sweep_limsup=np.array([limsup(loop.with_threshold(h)) for h in thresholds]),
    )


def threshold_curve(method: str) -> ThresholdCurve:
    """Simulated and guaranteed error against h, mirror example, one pixel.

    Parameters
    ----------
    method
        How the controller is found.
    """
    plain = scenario('mirror', 1)
    problem = DesignProblem.from_scenario(plain).continuous
    design = design_controller(problem, method=method)
    loop = ClosedLoop.from_scenario(plain, design.controller)
    thresholds = np.linspace(0.01, 0.3, 59)
    delta = np.array(
        [
            sector(problem.bounds, event_threshold=h, log_base=problem.log_base).error_bound.max()
            for h in thresholds
        ]
    )
    room = 1 - delta * design.figures.output_peak_gain
    gain = design.figures.state_peak_gain * problem.mean_luminosity
    bound = np.divide(gain * delta, room, out=np.full_like(delta, math.inf), where=room > 0)
    return ThresholdCurve(
        design=design,
        thresholds=thresholds,
        limsup=np.array([limsup(loop.with_threshold(h)) for h in thresholds]),
        bound=bound,
    )


def limsup(loop: ClosedLoop) -> float:
    """Largest error in the last half of a run of 40 s; infinite if the run broke off.

    Parameters
    ----------
    loop
        The loop.
    """
    run = simulate(loop, duration=40.0, tail_start=20.0, tail_step=0.02, record_events=False)
    return run.limsup


def worst_case_gain(experiment: Experiment, frequencies: FloatArray) -> FloatArray:
    """Largest gain from D to x over all complex ``|Delta_i| <= delta_z`` at each frequency.

    From ``x = G Delta (c'x + D)`` it is ``delta ||G|| / (1 - delta |T|)``; infinite where
    ``delta |T| >= 1`` (paper, eq. "relation", in the reduced problem).

    Parameters
    ----------
    experiment
        Design and threshold.
    frequencies
        w, shape (k,), rad/s.
    """
    model = experiment.loop.model
    response = state_response(model, experiment.design.controller).response(frequencies)[:, :, 0]
    delta = float(experiment.loop.sector().error_bound.max())
    room = 1 - delta * np.abs(response @ model.gradient)
    gain = delta * np.linalg.norm(response, axis=1)
    unbounded = np.full_like(gain, math.inf)
    return np.asarray(np.divide(gain, room, out=unbounded, where=room > 0))


def _experiment(
    design: Design, loop: ClosedLoop, *, duration: float = RUN_DURATION_S
) -> Experiment:
    run = simulate(
        loop,
        duration=duration,
        sample_times=np.linspace(0, duration, round(duration * 1000) + 1),
        tail_start=duration / 2,
    )
    return Experiment(design=design, loop=loop, run=run)
