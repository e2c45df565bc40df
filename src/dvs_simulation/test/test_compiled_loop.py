"""The compiled loop gives the bytes of the nodes' cores, or leaves the run to them."""

import math

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_hinf_controller.design.design import design_from_scenario
from dvs_simulation.paper.published import scenario
from dvs_simulation.sampled.compiled_loop import compiled_loop
from dvs_simulation.sampled.conditions import Conditions
from dvs_simulation.sampled.many_runs import run_many
from dvs_simulation.sampled.messages import messages_of
from dvs_simulation.sampled.sampled_loop import run_by_messages, run_sampled

PERIODS = 200


def random_scenario(rng):
    """Nine, three or one pixels of the mirror, with some imperfections, noise and ignorance."""
    options = {
        'sampling_period': float(rng.choice([0.001, 0.00137])),
        'event_threshold': float(rng.uniform(0.02, 0.2)),
        'seed': int(rng.integers(1000)),
        'initial_reference': str(rng.choice(['luminosity', 'lower', 'upper', 'random'])),
    }
    draws = {
        'input_disturbance': 0.3,
        'state_disturbance': 0.01,
        'threshold_mismatch': 0.03,
        'refractory_period': 0.003,
        'leak_rate': 2.0,
        'dead_pixel_fraction': 0.3,
        'event_threshold_off': 0.1,
        'threshold_uncertainty': (0.02, 0.03),
        'leak_uncertainty': 0.5,
        'command_limit': (1.0,),
        'log_floor': 0.001,
    }
    options |= {name: value for name, value in draws.items() if rng.random() < 0.25}
    if rng.random() < 0.2:
        options['reset'] = 'level'
    options['duration'] = PERIODS * options['sampling_period']
    pixels = int(rng.choice([1, 3, 9]))
    if pixels > 1 and rng.random() < 0.2:
        options['pixel_mask'] = (1,)
    return scenario('mirror', pixels).replace(**options)


def random_conditions(rng, plain):
    model = plain.model
    choices = {}
    if rng.random() < 0.3:
        error = 1 + 0.01 * rng.choice([-1, 1], model.state_matrix.shape)
        choices['plant'] = type(model)(
            state_matrix=model.state_matrix * error,
            input_matrix=model.input_matrix,
            output_vector=model.output_vector,
        )
    if rng.random() < 0.5:
        choices['initial_state'] = plain.initial_state * rng.uniform(0.95, 1.05, 2)
    if rng.random() < 0.5:
        choices['disturbance'] = rng.uniform(-0.3, 0.3, (PERIODS, model.input_count))
    if rng.random() < 0.5:
        choices['latencies_ns'] = rng.choice([0, 400_000, 1_500_000], PERIODS + 1)
    if rng.random() < 0.5:
        choices['lost'] = rng.random(PERIODS + 1) < 0.05
        choices['lost'][0] = False
    return Conditions(**choices)


@pytest.mark.ensemble
@pytest.mark.parametrize('seed', range(6))
def test_compiled_runs_have_the_bytes_of_the_nodes_cores(seed):
    rng = np.random.default_rng(seed)
    compiled = 0
    for _ in range(3):
        plain = random_scenario(rng)
        conditions = random_conditions(rng, plain)
        design = design_from_scenario(plain)
        run = compiled_loop(plain, design).run(conditions)
        try:
            reference = run_by_messages(plain, conditions=conditions, design=design)
        except ParameterError as error:
            assert 'luminosity' in str(error)
            assert run is None or not run.is_whole
            continue
        if run is not None:
            compiled += 1
            assert run.is_whole
            assert messages_of(run, plain) == reference.messages
    assert compiled


def test_a_long_run_is_compiled_and_reported_as_such():
    plain = scenario('mirror', 9).replace(duration=4.2)
    run = run_sampled(plain)
    assert run.compiled
    assert run.messages == run_by_messages(plain, design=run.design).messages


@pytest.mark.parametrize(
    'options',
    [
        {'shot_noise_rate': 1.0},
        {'cutoff_frequency': 100.0},
        {'interpolation': 'hermite'},
        {'photoreceptor': 'lin_log'},
        {'frame_rate': 10.0},
        {'latency': 0.001},
    ],
)
def test_what_is_not_compiled_is_left_to_the_nodes_cores(options):
    plain = scenario('mirror', 1).replace(duration=0.02, **options)
    loop = compiled_loop(plain, run_by_messages(plain).design)
    assert loop is None or loop.run() is None


def test_a_run_ends_at_a_luminosity_that_is_not_positive_as_the_nodes_end_it():
    plain = scenario('mirror', 1).replace(duration=4.2)
    push = Conditions(disturbance=np.full((4200, 1), -50.0))
    with pytest.raises(ParameterError, match='luminosity'):
        run_sampled(plain, conditions=push)


@pytest.mark.ensemble
def test_many_runs_are_the_runs_one_by_one():
    plain = scenario('mirror', 3).replace(duration=0.1, reference_uncertainty=0.002)
    design = run_by_messages(plain).design
    starts = plain.initial_state * np.linspace(0.98, 1.02, 5)[:, None]
    light = np.stack([plain.scene.luminosity(plain.model, start) for start in starts])
    push = np.random.default_rng(0).uniform(-1, 1, (5, 100, 1))
    many = run_many(
        plain,
        design,
        initial_states=starts,
        first_references=light + 0.001,
        disturbances=push,
    )
    loop = compiled_loop(plain, design)
    for i in range(5):
        one = loop.run(
            Conditions(
                initial_state=starts[i], first_reference=light[i] + 0.001, disturbance=push[i]
            )
        )
        assert np.array_equal(many.states[i], one.record.states)
        assert np.array_equal(many.commands[i], one.record.commands)
    assert many.samples.tolist() == [101] * 5
    assert not math.isnan(many.states.sum())


def test_runs_of_different_numbers_are_refused():
    plain = scenario('mirror', 1).replace(duration=0.1)
    design = run_by_messages(plain).design
    with pytest.raises(ParameterError, match='disturbances'):
        run_many(
            plain,
            design,
            initial_states=np.zeros((3, 2)) + 0.4,
            disturbances=np.zeros((2, 100, 1)),
        )
