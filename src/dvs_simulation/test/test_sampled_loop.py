import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.wire.messages import parse_state
from dvs_simulation.exact import ClosedLoop, simulate
from dvs_simulation.paper.published import scenario
from dvs_simulation.sampled.sampled_loop import run_sampled


def sampled_states(run):
    return np.array([parse_state(message).values for message in run.messages['state']])


def test_the_sampled_loop_converges_to_the_exact_one():
    """Before the first event the loops agree; then by the order of the sampling period."""
    errors = []
    for period in (4e-4, 1e-4, 2.5e-5):
        plain = scenario('mirror', 3, event_threshold=0.1).replace(
            sampling_period=period, duration=0.1
        )
        run = run_sampled(plain)
        states = sampled_states(run)
        exact = simulate(
            ClosedLoop.from_scenario(plain, run.design.controller),
            duration=0.1,
            sample_times=np.minimum(np.arange(len(states)) * period, 0.1),
        )
        errors.append(np.max(np.abs(states - exact.states)))
    assert errors[2] < 2e-4
    assert errors[1] < errors[0] / 2.5
    assert errors[2] < errors[1] / 2.5


def test_every_topic_has_one_message_a_sample_and_runs_repeat():
    plain = scenario('paper', 3).replace(duration=0.05)
    one, two = run_sampled(plain), run_sampled(plain)
    assert {name: len(messages) for name, messages in one.messages.items()} == dict.fromkeys(
        ('luminosity', 'state', 'events', 'command', 'estimate'), 51
    )
    assert one.messages == two.messages


def test_a_run_without_end_is_refused():
    with pytest.raises(ParameterError, match='duration'):
        run_sampled(scenario('mirror', 1).replace(duration=0.0))


def test_dark_pixels_stop_the_run():
    plain = scenario('paper', 1).replace(photoreceptor='log', duration=0.5)
    with pytest.raises(ParameterError, match='luminosity'):
        run_sampled(plain)


def test_model_and_scene_are_built_once_and_not_at_every_sample(monkeypatch):
    built = []
    for kind in (PlantModel, PixelScene):
        check = kind.__post_init__
        monkeypatch.setattr(kind, '__post_init__', lambda it, f=check: (built.append(it), f(it)))

    def number_built(samples):
        built.clear()
        run_sampled(scenario('mirror', 1).replace(duration=samples * 1e-3, sampling_period=1e-3))
        return len(built)

    assert 0 < number_built(100) == number_built(10)
