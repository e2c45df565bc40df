"""The largest threshold, and the largest sector of the estimates, that holds the tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.largest_level import largest_level
from dvs_hinf_controller.analysis.promise import Held
from dvs_hinf_controller.analysis.reference_widths import ReferenceWidths
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors

_ROUNDS = 60
_MARGIN = 1e-4

HeldBySectors = Callable[..., Held]


def largest_uncertainty(problem: DesignProblem, held: HeldBySectors) -> float:
    """Largest common sector delta with which the tolerance holds, in [0, 1]; 0 for none.

    Infinite where every sector will do.

    Parameters
    ----------
    problem
        Pixels and tolerance.
    held
        Bounds by the sectors of the pixels.
    """

    def excess(level: float) -> float:
        return held(Sectors(level=level, own_widths=False)).excess(problem)

    largest = largest_level(excess, low=0.0)
    if math.isinf(largest):
        return math.inf if largest > 0 else 0.0
    return math.tanh(largest)


def largest_threshold(problem: DesignProblem, held: HeldBySectors) -> float:
    """Largest h with which the tolerance holds, each pixel with what is known of its reference.

    ``delta_i = tanh(h ln b + w_i)`` with the ``w_i`` of `ReferenceWidths`. Zero or negative: q(0)
    is known too poorly; minus infinity: the tolerance fails at any threshold, or nothing bounds
    ``w_i``.

    Parameters
    ----------
    problem
        Pixels and tolerance.
    held
        Bounds by the sectors of the pixels.
    """
    base = math.log(problem.log_base)

    def excess(step: float) -> float:
        return held_at(problem, held, step / base).excess(problem)

    return largest_level(excess, low=-problem.pixels.widest) / base


def best_merit(problem: DesignProblem, held: HeldBySectors) -> float:
    """What a design maximises: the largest sector, or with anchors the largest threshold.

    With anchors a slower loop has a smaller drift, which the sector alone does not count.

    Parameters
    ----------
    problem
        Pixels and tolerance, with an operation.
    held
        Bounds by the sectors of the pixels.
    """
    assert problem.operation is not None
    anchored = problem.operation.sensor.anchor_period > 0
    return (largest_threshold if anchored else largest_uncertainty)(problem, held)


def held_at(
    problem: DesignProblem,
    held: HeldBySectors,
    event_threshold: float,
    *,
    start: FloatArray | None = None,
) -> Held:
    """Bounds at one threshold.

    Where sectors grow with the rate of the luminosity, and it with them, they are followed from
    zero up to where both agree.

    Parameters
    ----------
    problem
        Pixels, what is known of their references, and the sensor.
    held
        Bounds by the sectors of the pixels, and by a start where there is one.
    event_threshold
        h.
    start
        ``x - x_d`` at the start, for bounds that hold from then on; None for the limit.
    """
    widths = ReferenceWidths(problem, from_start=start is not None)
    step = event_threshold * math.log(problem.log_base)
    given = {} if start is None else {'start': start}
    rate = 0.0
    for _ in range(_ROUNDS):
        choices = [held(sectors, **given) for sectors in widths.sectors(step, rate)]
        found = min(choices, key=lambda one: one.excess(problem))
        if not widths.follow_rates or found.log_rate <= rate or math.isinf(found.log_rate):
            return found
        rate = found.log_rate * (1 + _MARGIN)
    return Held.nothing(problem)
