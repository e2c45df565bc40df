"""How far the real sensor may be from the ideal one, and what is done about it."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CONTROLLER
from dvs_common.scenario.schema import Interval

_RELATIVE = Interval(low=0, high=0.99)


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyParameters(ParameterGroup):
    """Bounds that the user vouches for; those of an ideal sensor are 0."""

    threshold_uncertainty: tuple[float, ...] = parameter(
        (),
        'Largest relative error of any ON and of any OFF threshold, 1 or 2 entries; empty: 0',
        nodes=(CONTROLLER,),
        interval=_RELATIVE,
    )
    leak_uncertainty: float = parameter(
        0.0,
        'Largest rate of ON events that leakage alone causes in a healthy pixel',
        nodes=(CONTROLLER,),
        unit='1/s',
        interval=Interval(low=0, high=1e6),
    )
    latency_uncertainty: float = parameter(
        0.0,
        'Longest time from what causes an event to its stamp; it widens what anchors prove, and '
        'the estimate is late by it',
        nodes=(CONTROLLER,),
        unit='s',
        interval=Interval(low=0, high=1.0),
    )
    anchor_uncertainty: float = parameter(
        0.0,
        'Largest relative error of the luminosities on anchor',
        nodes=(CONTROLLER,),
        interval=_RELATIVE,
    )
    anchor_period: float = parameter(
        0.0,
        'Longest time from an absolute measurement of luminosity to the arrival of the next one, '
        'for which h_certified holds with threshold_uncertainty and leak_uncertainty; 0: no such '
        'measurements, and nothing is promised with either',
        nodes=(CONTROLLER,),
        unit='s',
        interval=Interval(low=0, high=1e6),
    )
    pixel_mask: tuple[int, ...] = parameter(
        (),
        'Row-major numbers of pixels that the controller does not use; those that anchors '
        'contradict again and again are masked besides',
        nodes=(CONTROLLER,),
        interval=Interval(low=0, high=2**31 - 1),
    )
    unknown_references: str = parameter(
        'equilibrium',
        'What the controller does while no reference is known: apply the equilibrium input '
        '-B^+ A x_d, hold its last command, or stop with an error',
        nodes=(CONTROLLER,),
        choices=('equilibrium', 'hold', 'stop'),
    )
