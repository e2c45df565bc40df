"""The plant on the wall clock: each command acts from its arrival on, and time only goes on."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_plant_sim.plant import Plant
from dvs_plant_sim.realtime import RealtimePlant
from dvs_plant_sim.realtime_driver import RealtimeDriver

MS = 1_000_000


def integrator(x0=0.0):
    model = PlantModel(state_matrix=[[0.0]], input_matrix=[[1.0]], output_vector=[1.0])
    return RealtimePlant(Plant(model, initial_state=np.array([x0]), period_ns=4 * MS))


def command(value):
    return np.array([float(value)])


def test_it_rests_until_the_first_command():
    model = PlantModel(state_matrix=[[5.0]], input_matrix=[[1.0]], output_vector=[1.0])
    plant = RealtimePlant(Plant(model, initial_state=np.array([1.0]), period_ns=MS))

    plant.advance_to(1000 * MS)

    assert plant.state == [1]
    assert not plant.released


def test_a_command_acts_from_its_arrival_on():
    plant = integrator()
    plant.advance_to(4 * MS)
    plant.receive(5 * MS, command(1))
    plant.receive(6 * MS, command(10))
    assert plant.released

    plant.advance_to(8 * MS)

    # 1 ms at 1, 2 ms at 10.
    assert plant.state == pytest.approx([21e-3])


def test_a_command_that_has_not_arrived_yet_waits():
    plant = integrator()
    plant.receive(1 * MS, command(1))
    plant.receive(9 * MS, command(-1))

    plant.advance_to(4 * MS)
    assert plant.state == pytest.approx([3e-3])
    plant.advance_to(12 * MS)
    assert plant.state == pytest.approx([8e-3 - 3e-3])


def test_a_command_that_arrived_before_the_last_sample_acts_from_that_sample():
    plant = integrator()
    plant.receive(0, command(1))
    plant.advance_to(4 * MS)
    plant.receive(3 * MS, command(2))

    plant.advance_to(5 * MS)

    assert plant.state == pytest.approx([4e-3 + 2e-3])


@given(
    st.lists(st.tuples(st.integers(1, 20), st.integers(-9, 9)), min_size=1, max_size=8),
    st.lists(st.integers(1, 20), min_size=1, max_size=8),
)
def test_the_grid_of_samples_does_not_change_the_motion(arrivals, samples):
    """Any grid of samples gives the integral of the piecewise constant command."""
    gaps, values = zip(*arrivals, strict=True)
    times = np.cumsum(gaps)
    end = int(times[-1]) + 5
    expected = float(np.dot(np.diff([*times, end]), values))
    plant = integrator()
    clock = 0
    pending = list(zip(times.tolist(), values, strict=True))
    for step in [*samples, end]:
        clock = min(clock + step, end)
        while pending and pending[0][0] <= clock:
            at, value = pending.pop(0)
            plant.receive(at * MS, command(value))
        plant.advance_to(clock * MS)

    assert plant.state == pytest.approx([expected * 1e-3], abs=1e-12)
    assert plant.last_arrival_ns == times[-1] * MS


class Surroundings:
    """What a driver asks of its node while it starts, and the order in which it does."""

    def __init__(self):
        self.asked = []
        self.plant = None

    def subscribe(self, *_):
        pass

    def every(self, *_):
        return SimpleNamespace(reset=lambda: self.asked.append('timer'))

    def get_clock(self):
        return SimpleNamespace(now=self.now)

    def now(self):
        self.asked.append('clock')
        return SimpleNamespace(nanoseconds=1)


def test_the_timer_begins_once_the_clock_of_the_samples_is_read():
    node = Surroundings()
    RealtimeDriver(node, Scenario.from_values({'mode': 'realtime'})).start()

    assert node.asked == ['clock', 'timer']
