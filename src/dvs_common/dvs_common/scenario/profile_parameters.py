"""What the pixels see of ``c'(x + dx)`` where it is not a straight line."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CONTROLLER, PLANT
from dvs_common.scenario.schema import NON_NEGATIVE


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileParameters(ParameterGroup):
    """A brightness profile, and how much of it the promise covers."""

    brightness_profile: str = parameter(
        '',
        "Luminosity over c'(x + dx), where it is not that itself: a table of two columns (.csv), "
        'a picture (.png ...), FILE.py:FUNCTION or module:function. Tools take a path that begins '
        'with a dot as relative to the parameter file and hand on "knots S Y; S Y; ...". Empty: '
        'the straight line of the paper',
        nodes=(PLANT, CONTROLLER),
    )
    profile_range: tuple[float, ...] = parameter(
        (),
        "c'(x + dx) of the first and the last column of a picture, or between which a function is "
        'taken',
        nodes=(PLANT, CONTROLLER),
    )
    profile_reach: float = parameter(
        0.0,
        "Largest |c'(x - x_d)| for which the promise holds with a brightness_profile; 0: as far "
        'as the profile goes',
        nodes=(PLANT, CONTROLLER),
        interval=NON_NEGATIVE,
    )
