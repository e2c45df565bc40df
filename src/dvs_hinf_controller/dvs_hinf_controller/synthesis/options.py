"""What the user may choose in a design."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignOptions:
    """Trade between optimality and a loop that is slow enough to be sampled.

    Parameters
    ----------
    gamma_slack
        Relative excess over the least norm that may be paid for a slower controller, > 0. The
        default is the largest that leaves margin within 0.2 % of the optimum.
    bandwidth_limit
        Largest roll-off frequency of the loop, rad/s; 0 for none. Where it binds, the norm exceeds
        the optimum by more than `gamma_slack`.
    process_noise
        Intensity of the regularising noise on the state, relative to the plant's own rate: lets
        the filter Riccati equation forget the initial state.

    integral_action
        Whether an integrator stands before every input.

    Raises
    ------
    ParameterError
        If a value is out of range.
    """

    gamma_slack: float = 1.5e-3
    bandwidth_limit: float = 0.0
    process_noise: float = 1e-2
    integral_action: bool = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 1e-6 <= self.gamma_slack <= 10:
            raise ParameterError('gamma_slack', self.gamma_slack, 'must lie in [1e-6, 10]')
        if not 0 <= self.bandwidth_limit < math.inf:
            raise ParameterError(
                'bandwidth_limit', self.bandwidth_limit, 'must be >= 0 rad/s and finite'
            )
        if not 1e-6 <= self.process_noise <= 10:
            raise ParameterError('process_noise', self.process_noise, 'must lie in [1e-6, 10]')

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> DesignOptions:
        """Options of a scenario.

        Parameters
        ----------
        scenario
            Checked parameters.
        """
        return cls(
            gamma_slack=scenario.controller.gamma_slack,
            bandwidth_limit=scenario.controller.bandwidth_limit,
            process_noise=scenario.controller.process_noise,
            integral_action=scenario.controller.integral_action,
        )
