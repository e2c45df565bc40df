"""The sampled loop converges to the exact hybrid automaton as the sampling period goes to zero."""

import numpy as np
import pytest
from loop_support import CONFIG

from dvs_common.scenario.scenario import load_scenario
from dvs_common.wire.messages import parse_state
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.sampled.sampled_loop import run_sampled

# While the loop goes down to its limit cycle; later a late event shifts the phase of the cycle.
HORIZON_S = 0.4
PERIODS_S = (0.004, 0.002, 0.001, 0.0005)


@pytest.mark.parametrize('name', ['mirror_r1', 'mirror_r3', 'paper_r3'])
def test_the_trajectory_converges_with_first_order(name, record_property):
    scenario = load_scenario(CONFIG / f'{name}.yaml').replace(duration=HORIZON_S)
    times = np.arange(0, HORIZON_S + 1e-9, PERIODS_S[0])
    design = design_from_scenario(scenario)
    loop = ClosedLoop.from_scenario(scenario, design.controller)
    exact = simulate(loop, duration=HORIZON_S, sample_times=times).states
    errors = []
    for period in PERIODS_S:
        run = run_sampled(scenario.replace(sampling_period=period))
        states = np.array([parse_state(message).values for message in run.messages['state']])
        stride = round(PERIODS_S[0] / period)
        errors.append(np.abs(states[::stride] - exact).max())

    order = np.polyfit(np.log(PERIODS_S), np.log(errors), 1)[0]
    record_property('order', float(order))
    print(f'{name}: errors {np.array(errors)}, measured order {order:.2f}')
    # The command is held for a period: a delay of half of it, hence first order.
    assert 0.8 < order < 1.3
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 0.01
