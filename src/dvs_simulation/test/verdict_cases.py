"""Promises with chosen figures, for verdicts that several tests share."""

import numpy as np

from dvs_common.scenario.scenario import Scenario
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.state_space import StateSpace
from dvs_simulation.judging.promised import Promised


def promised_of(
    scenario: Scenario,
    *,
    h_star: float = 0.2,
    h_certified: float = 0.1,
    delta_certified: float = 0.3,
    pole: float = -20.0,
) -> Promised:
    """Promise of a loop in which every state decays with one pole."""
    n = scenario.model.state_count
    return Promised(
        h_star=h_star,
        h_certified=h_certified,
        delta_certified=delta_certified,
        problem=DesignProblem.from_scenario(scenario),
        loop=StateSpace(a=pole * np.eye(n), b=np.zeros((n, 1)), c=np.eye(n), d=np.zeros((n, 1))),
    )
