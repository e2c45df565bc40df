"""Which controller is designed."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CONTROLLER
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerParameters(ParameterGroup):
    """Method and options of the design, and limits of its commands."""

    method: str = parameter(
        'unstructured',
        'Controller K: unstructured or structured, least H-infinity norm or least mu (paper, '
        'Remark 2); certified, largest certified threshold; file, read from design_file; or a '
        'method that an installed package registers',
        nodes=(CONTROLLER,),
    )
    design_file: str = parameter(
        '',
        'Design saved by design_controller --output; only with method: file',
        nodes=(CONTROLLER,),
    )
    gamma_slack: float = parameter(
        1.5e-3,
        'Relative excess over the least norm that may be paid for a slower controller',
        nodes=(CONTROLLER,),
        interval=Interval(low=1e-6, high=10.0),
    )
    bandwidth_limit: float = parameter(
        0.0,
        'Largest roll-off frequency of the loop; 0: no limit',
        nodes=(CONTROLLER,),
        unit='rad/s',
        interval=NON_NEGATIVE,
    )
    process_noise: float = parameter(
        0.01,
        'Noise on the state that regularises the synthesis, relative to the rate of the plant '
        '(paper, Remark 6)',
        nodes=(CONTROLLER,),
        interval=Interval(low=1e-6, high=10.0),
    )
    integral_action: bool = parameter(
        False,
        'Whether an integrator stands before every input, so that a constant load moves neither '
        "c'x nor, if the plant has an input for each of its equilibria, x",
        nodes=(CONTROLLER,),
    )
    command_limit: tuple[float, ...] = parameter(
        (),
        'Largest |u_o| of every input, 1 or m entries; empty: no limit',
        nodes=(CONTROLLER,),
        unit='input',
        interval=POSITIVE,
    )
    command_rate_limit: tuple[float, ...] = parameter(
        (),
        'Largest change of u_o in a second, of every input, 1 or m entries; empty: no limit',
        nodes=(CONTROLLER,),
        unit='input/s',
        interval=POSITIVE,
    )
    command_copy: str = parameter(
        '',
        'Commands in another form beside command: array (std_msgs/Float64MultiArray on commands), '
        'or the field of every input in geometry_msgs/Twist (linear.x, angular.z; on cmd_vel) or '
        'geometry_msgs/Wrench (force.x, torque.z; on wrench); empty: none',
        nodes=(CONTROLLER,),
    )
