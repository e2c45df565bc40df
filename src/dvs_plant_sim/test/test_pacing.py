"""Simulated time against the wall clock; the clock is an argument, so nothing here waits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_plant_sim.pacing import Pace

S = 1_000_000_000


def test_as_fast_as_possible_never_waits():
    pace = Pace(0)

    assert [pace.delay_s(k * S, 0.0) for k in range(3)] == [0, 0, 0]


@pytest.mark.parametrize('factor', [0.5, 1.0, 4.0])
def test_simulated_seconds_take_their_share_of_wall_clock(factor):
    pace = Pace(factor)
    pace.delay_s(0, 100.0)

    assert pace.delay_s(2 * S, 100.0) == pytest.approx(2 / factor)
    assert pace.delay_s(2 * S, 100.1) == pytest.approx(2 / factor - 0.1)


def test_a_late_sample_is_due_at_once_and_the_delay_is_made_good():
    pace = Pace(1.0)
    pace.delay_s(0, 0.0)

    assert pace.delay_s(1 * S, 5.0) == 0
    assert pace.delay_s(6 * S, 5.0) == pytest.approx(1.0)


def test_the_clock_starts_with_the_first_sample():
    assert Pace(1.0).delay_s(7 * S, 1234.5) == 0


@given(st.floats(0.1, 10), st.floats(0.1, 10), st.floats(0, 100))
def test_a_new_factor_counts_from_the_sample_after_it(old, new, wall_s):
    pace = Pace(old)
    pace.delay_s(0, wall_s)
    pace.change(new)

    assert pace.delay_s(10 * S, wall_s) == 0
    assert pace.delay_s(11 * S, wall_s) == pytest.approx(1 / new, abs=1e-9)


def test_pacing_can_be_switched_off():
    pace = Pace(1.0)
    pace.delay_s(0, 0.0)
    pace.change(0)

    assert pace.delay_s(9 * S, 0.0) == 0
