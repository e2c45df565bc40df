"""The largest level of a monotone condition: where it is, from below, and how soon."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_hinf_controller.analysis.largest_level import largest_level


def bisected(excess, low: float) -> float:
    inside, outside = low, 18.0
    for _ in range(90):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if excess(middle) <= 1 else (inside, middle)
    return inside


@given(
    gain=st.floats(-3, 5),
    loop=st.floats(-3, 3),
    offset=st.sampled_from([0.0, 0.3, 0.999]),
    bend=st.sampled_from([0.0, 50.0]),
    light=st.floats(-4, 1),
    low=st.sampled_from([0.0, -0.05]),
)
def test_it_is_the_level_that_bisection_finds(gain, loop, offset, bend, light, low) -> None:
    """With constant parts, curvature, and a level at which all is lost."""

    def excess(level: float) -> float:
        delta = math.tanh(level - low)
        share = delta * 10**loop
        if share >= min(1, 10**light):
            return math.inf
        return offset + 10**gain * delta * (1 + bend * delta) / (1 - share)

    found, wanted = largest_level(excess, low=low), bisected(excess, low)

    if math.isinf(found):
        assert excess(18.0) <= 1
        return
    assert excess(found) <= 1
    assert found == pytest.approx(wanted, rel=0, abs=2e-10 * (wanted - low))


def test_the_sector_alone_takes_few_evaluations() -> None:
    levels = []

    def excess(level: float) -> float:
        levels.append(level)
        delta = math.tanh(level)
        return 8 * delta / (1 - 0.5 * delta) if delta < 2 else math.inf

    assert math.tanh(largest_level(excess, low=0.0)) == pytest.approx(1 / 8.5, rel=1e-9)
    assert len(levels) < 12


def test_no_level_and_every_level_are_opposite_infinities() -> None:
    assert largest_level(lambda level: 2.0, low=-0.1) == -np.inf
    assert largest_level(lambda level: 0.5, low=-0.1) == np.inf
