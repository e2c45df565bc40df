"""Maximise the certified threshold: peak-to-peak (L1) design by linear programming."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.largest_threshold import best_merit, largest_uncertainty
from dvs_hinf_controller.analysis.peak_gain import channel_gains
from dvs_hinf_controller.analysis.plant_list import held_with_all
from dvs_hinf_controller.analysis.plant_rates import plant_rate
from dvs_hinf_controller.analysis.promise import Continuous
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import state_response
from dvs_hinf_controller.synthesis.error_units import for_the_error
from dvs_hinf_controller.synthesis.group_weights import (
    GroupWeights,
    best_weights,
    synthesize_groups,
    weighted_controller,
)
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.order_reduction import reduced_controllers
from dvs_hinf_controller.synthesis.peak_to_peak import family_filters, peak_to_peak
from dvs_hinf_controller.synthesis.rolled_off import synthesize_unstructured
from dvs_hinf_controller.synthesis.settling import settled
from dvs_hinf_controller.synthesis.structured import synthesize_structured
from dvs_hinf_controller.synthesis.synthesis_error import Assumption, SynthesisError
from dvs_hinf_controller.synthesis.units import Units

# Fastest filter, over the plant's own rate.
_FASTEST_FILTER = 100.0
_FASTEST_SAMPLED_FILTER = 400.0
_SPREAD = 4.0
_CLIMB = (0.5, 2.0)
_MOST_STEPS = 5
# A bandwidth whose score is not better by so much ends a climb.
_WORTH_A_STEP = 1.005
# Rate of the observer, and whether the filters are rich, of an unsampled loop's families; for more
# states than these the first and third, since a program takes longer.
_FEW_STATES = 6
_FAMILIES = ((0.03, False), (4.0, False), (0.3, True), (0.03, True))
_SAMPLED_FAMILIES = ((0.5, False), (0.03, False), (4.0, False), (0.5, True), (0.03, True))
_FASTEST_IN_DELAY = 4.0
_LEAST_LUMINOSITY = 1e-3
_REDUCTION_LOSS = 2e-3
# Orders that are tried one by one; beyond them by bisection.
_LOW_ORDERS = 4
_COMPARISON_RTOL = 1e-3
_SEARCH_RTOL, _FINAL_RTOL = 5e-3, 3e-4
# Shares of the best score from which on a finer one decides; less for a rival, since none may be
# better, also where rounding makes coarse scores poor.
_WORTH_COMPARING, _WORTH_COMPARING_A_RIVAL = 0.98, 0.5


def synthesize_certified(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Controller with (nearly) the largest certified threshold of the loop that runs.

    Minimises ``N_G Dbar + eps N_T``, a convex function of the closed loop (Dahleh and Pearson
    1987), over Youla families whose filters are no faster than the bandwidth limit: few filters
    with real poles, or many, some of them damped, and the plant's own lightly damped modes. A
    sampled loop's families are strictly proper, since a command samples whatever jumps, and model
    latency and half a period as a delay; the certificate of the loop that runs chooses the
    bandwidth. The controllers of the other methods are candidates, and so is no feedback at all
    where the plant is stable; at last a low order is taken that loses next to nothing.

    With several pixel groups the certificate chooses the weights of H-infinity designs
    instead: the best that was found, with no claim to be the optimum (docs/pixel_groups.md).

    Parameters
    ----------
    problem
        Plant, luminosities, tolerance and how the loop runs.
    options
        Bandwidth limit; slack and process noise of the other methods.

    Raises
    ------
    SynthesisError
        If no method finds a controller; with the reason of the first.
    """
    search = _Search(problem, options)
    if problem.model.group_count > 1:
        search.add_rival(partial(synthesize_groups, problem, options))
        best_weights(search.add_weighted, GroupWeights.first(search.disturbances))
        return search.result()
    stable = np.linalg.eigvals(problem.model.state_matrix).real.max() < 0
    if stable and search.add(partial(_no_feedback, problem.model)) == math.inf:
        return search.result()
    for synthesize in (synthesize_unstructured, synthesize_structured):
        search.add_rival(partial(synthesize, options=options))
    fastest = search.fastest
    if not problem.operation:
        small = problem.model.state_count <= _FEW_STATES
        for rate, rich in _FAMILIES if small else _FAMILIES[::2]:
            search.add_peak_to_peak(rate, fastest, rich=rich)
        return search.result()
    start = fastest / _SPREAD
    for rate, rich in _SAMPLED_FAMILIES:
        start = search.climb(rate, start, rich=rich)
    return search.result()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    """A controller, its score, and whether it is another method's."""

    controller: LinearController
    score: float
    rival: bool


class _Search:
    """Candidates, by the certificate of the problem."""

    def __init__(self, problem: DesignProblem, options: DesignOptions) -> None:
        self.problem, self.options = problem, options
        self.candidates: list[_Candidate] = []
        self.failures: list[Exception] = []
        self.directions: list[FloatArray] = []

    @property
    def units(self) -> Units:
        return Units.of_problem(self.problem)

    @property
    def fastest(self) -> float:
        """Fastest filter that is worth a trial, in `units`."""
        units = self.units
        rate = plant_rate(units.plant(self.problem.model))
        fastest = _FASTEST_FILTER * rate
        if self.delay > 0:
            fastest = min(_FASTEST_SAMPLED_FILTER * rate, _FASTEST_IN_DELAY / self.delay)
        limit = units.options(self.options).bandwidth_limit
        return min(fastest, limit) if limit > 0 else fastest

    @property
    def delay(self) -> float:
        """Latency and half a period, in `units`."""
        operation = self.problem.operation
        if operation is None:
            return 0.0
        return (operation.latency + operation.sampling_period / 2) * self.units.rate

    def add(self, synthesize: Callable[[], LinearController], *, rival: bool = False) -> float:
        """Coarse score of a candidate."""
        try:
            controller = synthesize()
            abscissa = state_response(self.problem.model, controller).abscissa
            if not abscissa < -self.problem.least_decay:
                detail = f'a closed-loop pole has real part {abscissa:.3g}'
                raise SynthesisError(Assumption.CONFIRMATION, detail)
            with np.errstate(over='ignore', invalid='ignore'):  # without a bound: no candidate
                score = _score(self.problem, controller, rtol=_SEARCH_RTOL)
        except (SynthesisError, np.linalg.LinAlgError) as error:
            self.failures.append(error)
            return -math.inf
        self.candidates.append(_Candidate(controller=controller, score=score, rival=rival))
        return score

    def add_rival(self, synthesize: Callable[[PlantModel], LinearController]) -> None:
        """Add the candidate of another method."""
        self.add(lambda: for_the_error(self.problem, synthesize), rival=True)

    def add_peak_to_peak(self, observer_rate: float, fastest: float, *, rich: bool) -> float:
        """Score of the best controller of a Youla family."""
        units = self.units

        def of_family(model: PlantModel) -> LinearController:
            found = peak_to_peak(
                units.plant(model),
                observer_rate=observer_rate,
                filters=family_filters(
                    units.plant(model), fastest, rich=rich, patient=self.problem.operation is None
                ),
                delay=self.delay,
                strictly_proper=self.problem.operation is not None,
                directions=self.directions,
            )
            return units.controller(found)

        return self.add(lambda: settled(self.problem, of_family))

    @property
    def disturbances(self) -> FloatArray:
        """Mean luminosity of every group: what its mean disturbance grows with, in `units`."""
        return np.maximum(
            self.problem.pixels.group_means / self.units.luminosity, _LEAST_LUMINOSITY
        )

    def add_weighted(self, weights: GroupWeights) -> float:
        """Score of the H-infinity controller for weights."""
        units = self.units
        limit = units.options(self.options).bandwidth_limit or math.inf

        def of_weights(model: PlantModel) -> LinearController:
            return units.controller(weighted_controller(units.plant(model), weights, limit=limit))

        return self.add(lambda: settled(self.problem, of_weights))

    def climb(self, observer_rate: float, start: float, *, rich: bool) -> float:
        """Go down or up from a bandwidth while the score grows; return the best bandwidth."""
        limit = self.units.options(self.options).bandwidth_limit or math.inf
        best, score = start, self.add_peak_to_peak(observer_rate, start, rich=rich)
        for factor in _CLIMB:
            at, here = start, score
            for _ in range(_MOST_STEPS):
                if at == limit < at * factor:
                    break
                at = min(at * factor, limit)
                found = self.add_peak_to_peak(observer_rate, at, rich=rich)
                if found > score * _WORTH_A_STEP:
                    best, score = at, found
                elif math.isfinite(found):
                    break
            if score > here:
                break
        return best

    def result(self) -> LinearController:
        """The best controller, or one of lower order that loses next to nothing.

        None of the other methods' is better, to the accuracy of the certificate itself.
        """
        if not self.candidates:
            raise self.failures[0]
        coarsely_best = max(self.candidates, key=lambda k: k.score)
        if not math.isfinite(coarsely_best.score):
            return coarsely_best.controller
        least = {
            False: _WORTH_COMPARING * coarsely_best.score,
            True: _WORTH_COMPARING_A_RIVAL * coarsely_best.score,
        }
        close = [self._compared(k) for k in self.candidates if k.score >= least[k.rival]]
        best = max(close, key=lambda k: k.score)
        reduced = self._reduced(best)
        equal = _WORTH_COMPARING * best.score
        rivals = [k.controller for k in close if k.rival and k.score >= equal]
        if not rivals:
            return reduced
        return max([reduced, *rivals], key=lambda k: _score(self.problem, k, rtol=_FINAL_RTOL))

    def _compared(self, candidate: _Candidate) -> _Candidate:
        return replace(candidate, score=_score(self.problem, candidate.controller))

    def _reduced(self, best: _Candidate) -> LinearController:
        try:
            truncations = reduced_controllers(self.problem.model, best.controller)
        except np.linalg.LinAlgError:
            return best.controller
        enough = best.score * (1 - _REDUCTION_LOSS)
        low, high = min(_LOW_ORDERS, len(truncations)), len(truncations)
        for candidate in truncations[:low]:
            if _score(self.problem, candidate) >= enough:
                return candidate
        while low < high:
            middle = (low + high) // 2
            if _score(self.problem, truncations[middle]) >= enough:
                high = middle
            else:
                low = middle + 1
        return truncations[high] if high < len(truncations) else best.controller


def _no_feedback(model: PlantModel) -> LinearController:
    m = model.input_count
    return LinearController(
        state_matrix=np.zeros((0, 0)),
        input_vector=np.zeros(0),
        output_matrix=np.zeros((m, 0)),
        feedthrough=np.zeros(m),
    )


def _score(
    problem: DesignProblem, controller: LinearController, *, rtol: float = _COMPARISON_RTOL
) -> float:
    """Relative error of the estimate that the loop bears; minus infinity if it bears none."""
    g = state_response(problem.model, controller)
    if not g.abscissa < -problem.least_decay:
        return -math.inf
    if problem.operation is None:
        gains = channel_gains(g, problem.model.gradients, weights=problem.error_weights, rtol=rtol)
        found = largest_uncertainty(problem, Continuous(problem, gains).held)
    else:
        held = held_with_all(problem, controller, problem.operation, rtol=rtol)
        found = best_merit(problem, held)
    return found if found > 0 else -math.inf
