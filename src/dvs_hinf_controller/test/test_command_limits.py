"""Limits of the command and of its rate: what is sent, and the lag that K measures besides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import EVENT_DTYPE, EventPacket
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_hinf_controller.running.command_limiter import CommandLimiter
from dvs_hinf_controller.running.make_controller import event_controller

PERIOD = 0.005
LOOP = Scenario.from_values({'sampling_period': PERIOD})
PROBLEM = design_from_scenario(LOOP).problem


def limiter(magnitude=np.inf, rate=np.inf):
    made = CommandLimiter.where_limited(PROBLEM, np.array([magnitude]), np.array([rate]))
    made.begin(np.zeros(1))
    return made


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=30))
def test_neither_limit_is_ever_exceeded(wanted):
    bounded = limiter(magnitude=3.0, rate=100.0)
    before = bounded.command
    for value in wanted:
        bounded.advance(0.01)
        bounded.take(np.array([value]), 0.01, is_resting=False)
        assert abs(bounded.command[0]) <= 3.0
        assert abs(bounded.command[0] - before[0]) <= 1.0 + 1e-12
        before = bounded.command


def test_the_lag_is_that_of_the_plant_behind_one_without_limits():
    """Reference: both plants, each under its own command."""
    model = PROBLEM.model
    bounded, free, held = limiter(magnitude=0.5), np.zeros(2), np.zeros(2)
    wanted = np.array([2.0])
    step = 1e-5
    for _ in range(1000):
        bounded.take(wanted, step, is_resting=False)
        bounded.advance(step)
        free = free + step * (model.state_matrix @ free + model.input_matrix @ wanted)
        held = held + step * (model.state_matrix @ held + model.input_matrix @ bounded.command)

    lag = float(model.output_vector @ (free - held))
    assert bounded.luminosity == pytest.approx(lag, rel=1e-3)
    assert bounded.limited == 1000


def test_a_lag_is_taken_back_once_the_command_is_free_again():
    bounded = limiter(magnitude=0.5)
    for k in range(2000):
        bounded.take(np.array([0.6 if k < 20 else 0.0]), PERIOD, is_resting=False)
        bounded.advance(PERIOD)

    assert abs(bounded.luminosity) < 1e-6
    assert not bounded.is_limited


def test_a_resting_controller_has_no_lag_to_take_back():
    bounded = limiter(magnitude=0.5)
    bounded.take(np.array([5.0]), PERIOD, is_resting=False)
    bounded.advance(PERIOD)
    assert bounded.luminosity > 0

    bounded.take(np.array([5.0]), PERIOD, is_resting=True)
    bounded.advance(PERIOD)
    assert bounded.luminosity == 0


def test_a_rate_starts_from_the_command_that_holds_the_set_point():
    scenario = LOOP.replace(command_rate_limit=[1.0])
    design = design_from_scenario(scenario)

    first = event_controller(design, scenario).command
    assert first.tolist() == design.problem.equilibrium.feedforward.tolist()


def test_a_command_that_may_be_limited_is_not_sent_before_its_limit_is_known():
    free, limited = LOOP, LOOP.replace(command_limit=[1e-3])
    foreseen = []
    for scenario in (free, limited):
        controller = event_controller(design_from_scenario(scenario), scenario)
        for stamp_ns in (0, 5_000_000):
            controller.take(EventPacket(stamp_ns=stamp_ns, events=np.zeros(0, EVENT_DTYPE)))
        controller.look_ahead()
        silence = EventPacket(stamp_ns=10_000_000, events=np.zeros(0, EVENT_DTYPE))
        foreseen.append(controller.foreseen(silence))

    assert foreseen[0] is not None
    assert foreseen[1] is None
