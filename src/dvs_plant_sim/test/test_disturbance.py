"""Noise on any plant: seeded, of the right size, and nothing where there is none."""

import numpy as np
import pytest

from dvs_common.scenario.model import PlantModel
from dvs_common.scenario.scenario import Scenario
from dvs_plant_sim.disturbance import DisturbedPlant, disturbed
from dvs_plant_sim.pendulum import Pendulum, PendulumConstants
from dvs_plant_sim.plant import Plant

MS = 1_000_000
CONSTANTS = PendulumConstants(mass=0.2, length=1.0, friction=0.02, gravity=9.81)


def integrator():
    model = PlantModel(state_matrix=[[0.0]], input_matrix=[[1.0]], output_vector=[1.0])
    return Plant(model, initial_state=np.zeros(1), period_ns=MS)


def pendulum():
    return Pendulum(CONSTANTS, initial_state=np.array([0.2, 0.0]))


def walk(plant, steps, **noise):
    noise = {'input_disturbance': 0.0, 'state_disturbance': 0.0, 'seed': 0, **noise}
    plant = DisturbedPlant(plant, **noise)
    states = []
    for _ in range(steps):
        plant.advance(MS, np.zeros(1))
        states.append(plant.state.copy())
    return np.array(states)


def test_without_noise_it_is_the_plant_to_the_bit():
    bare = pendulum()
    states = walk(pendulum(), 50)
    for _ in range(50):
        bare.advance(MS, np.zeros(1))
    assert states[-1].tobytes() == bare.state.tobytes()


@pytest.mark.parametrize('make', [integrator, pendulum])
def test_the_seed_decides(make):
    one, two, other = (
        walk(make(), 20, input_disturbance=0.5, state_disturbance=0.1, seed=seed)
        for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, two)
    assert np.abs(one - other).max() > 0


def test_noise_has_the_size_of_the_parameters():
    increments = np.diff(walk(integrator(), 20_000, input_disturbance=2.0)[:, 0])
    assert increments.std() == pytest.approx(2.0 * 1e-3, rel=0.03)

    increments = np.diff(walk(integrator(), 20_000, state_disturbance=0.5)[:, 0])
    assert increments.std() == pytest.approx(0.5 * np.sqrt(1e-3), rel=0.03)


def test_a_constant_load_is_added_to_every_command():
    plant = disturbed(integrator(), Scenario.from_values({'constant_load': [0.25]}))

    plant.advance(MS, np.array([1.0]))

    np.testing.assert_allclose(plant.state, [1.25e-3])
