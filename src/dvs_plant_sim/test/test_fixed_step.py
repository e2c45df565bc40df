"""A simulator of fixed steps takes durations of any length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_plant_sim.fixed_step import FixedStep


def counting(step_ns):
    return FixedStep(lambda x, u: x + u, step_ns=step_ns, initial_state=np.zeros(1))


@given(st.lists(st.integers(0, 10_000), max_size=30), st.integers(1, 3_000))
def test_as_many_steps_are_taken_as_fit_the_whole_time(durations, step_ns):
    plant = counting(step_ns)
    for duration_ns in durations:
        plant.advance(duration_ns, np.ones(1))

    assert plant.state[0] == sum(durations) // step_ns


def test_a_step_acts_under_the_command_of_its_end():
    plant = counting(1000)
    plant.advance(1500, np.array([1.0]))
    plant.advance(500, np.array([10.0]))

    assert plant.state.tolist() == [11.0]


def test_a_step_has_a_length():
    with pytest.raises(ParameterError, match='step_ns'):
        counting(0)
