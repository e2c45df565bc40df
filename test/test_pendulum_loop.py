"""The pendulum: non-linear inside, checked against its scenario, regulated like any plant."""

import numpy as np
import pytest
from loop_support import CONFIG, ROOT, ros_arguments, run_closed_loop, start
from scipy.linalg import expm

from dvs_closed_loop.bags.bag import read_bag
from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import parse_command, parse_state

PENDULUM = CONFIG / 'pendulum.yaml'


def refusal(executable, domain, processes, **parameters):
    process = start(executable, domain, ros_arguments(parameters, PENDULUM))
    processes.append(process)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 2
    assert 'Traceback' not in output
    return output


def states_and_commands(folder):
    bag = read_bag(folder)
    states = [parse_state(message).values for message in bag.of(topics.STATE)]
    commands = [parse_command(message).values for message in bag.of(topics.COMMAND)]
    return np.array(states), np.array(commands)


def test_the_plant_is_not_the_linear_one_that_the_design_knows(domain, tmp_path):
    run_closed_loop('pendulum', domain, tmp_path, '--duration', '0.1')
    states, commands = states_and_commands(tmp_path / 'pendulum' / 'bag')
    model = load_scenario(PENDULUM).model
    generator = np.zeros((3, 3))
    generator[:2, :2], generator[:2, 2:] = model.state_matrix, model.input_matrix
    step = expm(generator * 1e-3)
    linear = states[:-1] @ step[:2, :2].T + commands[:-1] @ step[:2, 2:].T

    difference = states[1:, 1] - linear[:, 1]
    angle = states[:-1, 0]
    np.testing.assert_allclose(difference, 9.81e-3 * (np.sin(angle) - angle), rtol=0.02)


def test_the_linear_plant_refuses_the_pendulums_parameters(domain, processes):
    assert 'plant.mass = 0.2: is not a parameter' in refusal('plant_sim', domain, processes)


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'plant.mass': 0.3}, 'is not the linearisation of this pendulum at the top, [0, 1, 9.81'),
        ({'plant.length': -1.0}, 'plant.length = -1.0: must be a finite double > 0'),
        ({'plant.lenght': 1.0}, 'plant.lenght = 1.0: is not a parameter of this suite; did you'),
    ],
)
def test_parameters_that_do_not_fit_are_refused(parameters, message, domain, processes):
    assert message in refusal('pendulum_sim', domain, processes, **parameters)


def test_its_scenario_bounds_the_first_luminosity():
    scenario = load_scenario(PENDULUM)
    offsets = scenario.scene.brightness_offsets
    first = np.sin(scenario.initial_state[0]) + offsets
    bounds = scenario.reference_bounds(first)

    np.testing.assert_allclose((bounds.lower + bounds.upper) / 2, first, atol=1e-9)
    np.testing.assert_allclose(bounds.upper - bounds.lower, 2 * 0.002, atol=1e-9)
    assert (ROOT / 'src/dvs_plant_sim/launch/pendulum_sim.launch.py').is_file()
