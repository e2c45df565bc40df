"""What the loop that runs stays within at one threshold: for ever, and from its start on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dvs_hinf_controller.analysis.promise import Held
from dvs_hinf_controller.design.certification import held_from
from dvs_hinf_controller.design.design import Design


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningBounds:
    """Bounds at one threshold.

    Parameters
    ----------
    in_the_limit
        Bounds that hold in the end.
    from_its_start
        Bounds that hold from the start on; None where no start is known.
    """

    in_the_limit: Held
    from_its_start: Held | None

    @classmethod
    def of(cls, design: Design, event_threshold: float) -> RunningBounds:
        """Bounds of a design.

        Parameters
        ----------
        design
            Design of a problem with an operation.
        event_threshold
            h.
        """
        problem, k = design.problem, design.controller
        start = problem.initial_state
        return cls(
            in_the_limit=held_from(problem, k, event_threshold),
            from_its_start=None
            if start is None
            else held_from(problem, k, event_threshold, start=start - problem.equilibrium.state),
        )

    @property
    def luminosity_stays_positive(self) -> bool:
        """Whether the luminosity of every pixel stays positive from the start on."""
        return self.from_its_start is not None and math.isfinite(self.from_its_start.error)

    def as_json_object(self) -> dict[str, Any]:
        """Bounds by name; null where there is none."""
        return {
            'in_the_limit': _bounds(self.in_the_limit),
            'from_its_start': self.from_its_start and _bounds(self.from_its_start),
            'light_stays_on': self.luminosity_stays_positive,
        }


def _bounds(held: Held) -> dict[str, Any]:
    return {
        'error': _finite(held.error),
        'output': _finite(held.output),
        'commands': [_finite(bound) for bound in held.commands.tolist()],
    }


def _finite(bound: float) -> float | None:
    return bound if math.isfinite(bound) else None
