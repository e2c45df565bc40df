"""What the promise of a design covers beside the estimation error."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CONTROLLER
from dvs_common.scenario.schema import NON_NEGATIVE, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class PromiseParameters(ParameterGroup):
    """Bounds of what acts on the loop that runs; h_certified holds for all of them together."""

    loop_latency: float = parameter(
        0.0,
        'Time from a luminosity sample to the instant at which its command acts',
        nodes=(CONTROLLER,),
        unit='s',
        interval=Interval(low=0, high=10.0),
    )
    loop_latency_jitter: float = parameter(
        0.0,
        'Largest deviation from loop_latency, either way; at most loop_latency and half of '
        'sampling_period',
        nodes=(CONTROLLER,),
        unit='s',
        interval=NON_NEGATIVE,
    )
    disturbance_bound: tuple[float, ...] = parameter(
        (),
        'Largest disturbance of every input, 0, 1 or m entries; empty: none',
        nodes=(CONTROLLER,),
        unit='input',
        interval=NON_NEGATIVE,
    )
    constant_load_bound: tuple[float, ...] = parameter(
        (),
        'Largest constant load on every input, 0, 1 or m entries; empty: none. With '
        'integral_action it costs nothing in the limit',
        nodes=(CONTROLLER,),
        unit='input',
        interval=NON_NEGATIVE,
    )
    output_disturbance_bound: float = parameter(
        0.0,
        'Largest constant error of every luminosity',
        nodes=(CONTROLLER,),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    model_uncertainty: float = parameter(
        0.0,
        'Largest relative error of every entry of state_matrix and input_matrix',
        nodes=(CONTROLLER,),
        interval=Interval(low=0, high=0.99),
    )
    further_state_matrices: tuple[float, ...] = parameter(
        (),
        'Further plants for which the promise holds too: their A one after the other, k x n x n, '
        'row-major; empty: A itself with every further B',
        nodes=(CONTROLLER,),
        unit='1/s',
    )
    further_input_matrices: tuple[float, ...] = parameter(
        (),
        'Their B, k x n x m, row-major; empty: B itself with every further A',
        nodes=(CONTROLLER,),
        unit='state/(input s)',
    )
