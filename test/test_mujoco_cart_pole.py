"""examples/mujoco_cart_pole: another simulator in the loop, from model to verdict.

Its node takes the place of the plant in test_documented_commands.
"""

import sys

import numpy as np
import pytest
from loop_support import ROOT
from scipy.linalg import logm

from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.design import design_from_scenario, save_design
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import Promised, judge
from dvs_simulation.sampled.sampled_loop import run_sampled

mujoco = pytest.importorskip('mujoco')
FOLDER = ROOT / 'examples' / 'mujoco_cart_pole'
sys.path.insert(0, str(FOLDER))
import cart_pole  # noqa: E402

SCENARIO = FOLDER / 'cart_pole.yaml'


def test_the_scenario_holds_the_linearisation_of_the_model():
    scenario = load_scenario(SCENARIO)

    for name, value in cart_pole.scenario_values().items():
        np.testing.assert_allclose(scenario[name], value, atol=1e-7, err_msg=name)


def test_the_linearisation_is_that_of_mujoco_itself():
    model = mujoco.MjModel.from_xml_path(str(cart_pole.MODEL))
    a, b, _, _ = cart_pole.linearisation()
    errors = []
    for step in (1e-3, 1e-4):
        model.opt.timestep = step
        data = mujoco.MjData(model)
        discrete_a, discrete_b = np.zeros((4, 4)), np.zeros((4, 1))
        mujoco.mjd_transitionFD(model, data, 1e-6, True, discrete_a, discrete_b, None, None)
        errors.append(np.abs(logm(discrete_a) / step - a).max())
        np.testing.assert_allclose(discrete_b[2:] / step, b[2:], rtol=20 * step)

    # Euler's rule is wrong by the order of its step.
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 8


@pytest.mark.parametrize('lengths', [[5_000_000], [1_234_567, 3_765_433], [1] + [4_999_999]])
def test_durations_of_any_length_end_at_the_same_time(lengths):
    plant = cart_pole.CartPole([0.1, 0.05, 0.0, 0.0])
    for duration_ns in lengths:
        plant.advance(duration_ns, np.array([0.3]))

    whole = cart_pole.CartPole([0.1, 0.05, 0.0, 0.0])
    whole.advance(5_000_000, np.array([0.3]))
    np.testing.assert_allclose(plant.state, whole.state, atol=2e-5)


def test_ten_random_starts_end_regulated(tmp_path):
    scenario = load_scenario(SCENARIO).replace(duration=4.0)
    file = tmp_path / 'design.json'
    save_design(design_from_scenario(scenario), file)
    scenario = scenario.replace(method='file', design_file=str(file))
    generator = np.random.default_rng(14)
    for _ in range(10):
        start = np.array([*generator.uniform(-1, 1, 2) * (0.08, 0.025), 0.0, 0.0])
        own = scenario.replace(initial_state=start.tolist())
        run = run_sampled(own, plant=cart_pole.CartPole(start), luminosity=cart_pole.luminosity)
        figures = run.design.figures
        verdict = judge(
            decode_trace(run.messages),
            own,
            name='cart_pole',
            promised=Promised.of(run.design),
            wall_seconds=1.0,
            interrupted=False,
        )
        assert own.sensor.event_threshold < figures.h_certified
        assert verdict.regulated, f'{start}: {verdict}'
        assert verdict.sector_held
