"""examples/mujoco_cart_pole: another simulator in the loop, from model to verdict.

Its node takes the place of the plant in test_documented_commands.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from loop_support import ROOT, environment, program
from scipy.linalg import logm

from dvs_common.scenario.scenario import load_scenario
from dvs_hinf_controller.design.certification import farthest_start
from dvs_hinf_controller.design.design import design_from_scenario, save_design
from dvs_simulation.judging.promised import Promised
from dvs_simulation.judging.trace import decode_trace
from dvs_simulation.judging.verdict import judge
from dvs_simulation.sampled.sampled_loop import run_sampled

mujoco = pytest.importorskip('mujoco')
FOLDER = ROOT / 'examples' / 'mujoco_cart_pole'
sys.path.insert(0, str(FOLDER))
import cart_pole  # noqa: E402

SCENARIO = FOLDER / 'cart_pole.yaml'
# All tests on one worker, which makes their design.
pytestmark = pytest.mark.xdist_group('test_mujoco_cart_pole')


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


@pytest.fixture(scope='module')
def designed(tmp_path_factory):
    """The scenario with its design in a file, for runs of twelve seconds."""
    scenario = load_scenario(SCENARIO).replace(duration=12.0)
    file = tmp_path_factory.mktemp('design') / 'design.json'
    save_design(design_from_scenario(scenario), file)
    return scenario.replace(method='file', design_file=str(file))


def judged(scenario, luminosity):
    plant = cart_pole.CartPole(scenario.initial_state)
    run = run_sampled(scenario, plant=plant, luminosity=luminosity)
    return judge(
        decode_trace(run.messages),
        scenario,
        name='cart_pole',
        promised=Promised.of(run.design),
        wall_seconds=1.0,
        interrupted=False,
    )


@pytest.mark.parametrize('count', [3, pytest.param(10, marks=pytest.mark.long)])
def test_random_starts_within_the_promised_set_end_regulated(count, designed):
    design = design_from_scenario(designed)
    h = designed.sensor.event_threshold
    generator = np.random.default_rng(14)
    for _ in range(count):
        direction = generator.normal(size=4) * (0.08, 0.03, 0.08, 0.08)
        edge = farthest_start(design.problem, design.controller, h, direction)
        start = edge * generator.uniform(0.3, 1.0)
        assert np.linalg.norm(start) > 0.02

        verdict = judged(
            designed.replace(initial_state=start.tolist()), luminosity=cart_pole.luminosity
        )

        assert verdict.regulated, f'{start}: {verdict}'
        assert verdict.sector_held
        assert '(promised for the linear model)' in str(verdict), verdict


RENDERED = """
import json, sys
sys.path.insert(0, sys.argv[1])
from rendered import RenderedOptics
import cart_pole
states = json.load(sys.stdin)
optics = RenderedOptics()
print(json.dumps([optics.luminosity(state).tolist() for state in states]))
"""


def rendered(states):
    """Luminosities of rendered frames; in a process, since mujoco reads MUJOCO_GL once."""
    reasons = []
    for library in ('egl', 'osmesa'):
        run = subprocess.run(
            [sys.executable, '-c', RENDERED, str(FOLDER)],
            input=json.dumps(np.asarray(states).tolist()),
            env={**os.environ, 'MUJOCO_GL': library},
            capture_output=True,
            text=True,
            timeout=60,
        )
        if run.returncode == 0:
            return np.array(json.loads(run.stdout.splitlines()[-1])), library
        reasons.append(f'{library}: {run.stderr.strip().splitlines()[-1]}')
    pytest.skip(f'neither EGL nor OSMesa renders here ({"; ".join(reasons)})')


def test_rendered_frames_show_what_the_optics_compute():
    generator = np.random.default_rng(3)
    states = generator.uniform(-1, 1, (200, 4)) * (0.15, 0.05, 1.0, 1.0)

    seen, _ = rendered(states)

    expected = [cart_pole.luminosity(state) for state in states]
    # Less than `reference_uncertainty`, what the design allows the first frame to be off.
    np.testing.assert_allclose(seen, expected, atol=1e-3)
    assert np.abs(seen - expected).max() > 1e-5


def test_the_loop_is_closed_through_rendered_frames(designed, domain, tmp_path):
    library = rendered(np.zeros((1, 4)))[1]
    text = SCENARIO.read_text().replace('./cart_pole_node.py', str(FOLDER / 'rendered_node.py'))
    design = f'method: file\n    design_file: {designed.controller.design_file}'
    text = text.replace('method: certified', design).replace('[0.06, 0.02', '[0.02, 0.005')
    file = tmp_path / 'rendered.yaml'
    file.write_text(text)

    run = subprocess.run(
        [program('closed_loop'), '--params-file', file, '--output', tmp_path, '--duration', '1'],
        env={**environment(domain), 'MUJOCO_GL': library},
        capture_output=True,
        text=True,
        timeout=120,
    )

    assert run.returncode == 0, run.stderr
    assert 'rendered: regulated' in run.stdout
