"""Exact propagation against closed forms and tight numerical integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PlantModel
from dvs_plant_sim.plant import Plant

MS = 1_000_000
S = 1_000_000_000


def plant(a, b, x0, period_ns=MS):
    a = np.atleast_2d(np.array(a, dtype=float))
    b = np.array(b, dtype=float).reshape(len(a), -1)
    model = PlantModel(state_matrix=a, input_matrix=b, output_vector=np.ones(len(a)))
    return Plant(model, initial_state=np.array(x0, dtype=float), period_ns=period_ns)


def run(simulated, *steps):
    for duration_ns, command in steps:
        simulated.advance(duration_ns, np.atleast_1d(np.array(command, dtype=float)))
    return simulated.state


poles = st.one_of(st.just(0.0), st.floats(1e-9, 3), st.floats(-3, -1e-9))


@given(poles, st.floats(-5, 5), st.floats(-5, 5), st.integers(1, 2 * S))
def test_a_first_order_plant_follows_its_exponential(pole, x0, u, duration_ns):
    t = duration_ns * 1e-9
    forced = t if pole == 0 else np.expm1(pole * t) / pole

    found = run(plant(pole, 1, [x0]), (duration_ns, u))

    assert found == pytest.approx([np.exp(pole * t) * x0 + forced * u], rel=1e-12, abs=1e-13)


@given(st.integers(1, 5), st.integers(1, 5 * S), st.floats(-3, 3))
def test_an_integrator_chain_integrates_a_held_input_to_a_polynomial(n, duration_ns, u):
    t = duration_ns * 1e-9
    b = np.eye(n)[:, -1]
    x0 = np.arange(1.0, n + 1)
    factorial = [float(np.prod(np.arange(1, k + 1))) for k in range(n + 1)]
    expected = [
        sum(x0[j] * t ** (j - i) / factorial[j - i] for j in range(i, n))
        + u * t ** (n - i) / factorial[n - i]
        for i in range(n)
    ]

    found = run(plant(np.diag(np.ones(n - 1), 1), b, x0), (duration_ns, u))

    np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_a_defective_plant():
    # exp of a Jordan block: e^(p t) (1, t; 0, 1).
    t, pole = 0.7, -2.0
    expected = np.exp(pole * t) * np.array([[1, t], [0, 1]]) @ [3.0, 4.0]

    found = run(plant([[pole, 1], [0, pole]], [0, 1], [3, 4]), (700 * MS, 0))

    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_an_oscillator_comes_back_after_its_period():
    w = 2 * np.pi * 5
    simulated = plant([[0, w], [-w, 0]], [0, 0], [0.3, -0.4])

    np.testing.assert_allclose(run(simulated, *[(MS, 0)] * 200), [0.3, -0.4], atol=1e-12)


def test_the_equilibrium_stays():
    model = PlantModel(
        state_matrix=[[2, 10], [0, 5]], input_matrix=[[1], [1]], output_vector=[2, 1]
    )
    held = model.equilibrium([0.2321, -0.0928], tolerance=1e-3)
    simulated = Plant(model, initial_state=held.state, period_ns=MS)

    simulated.advance(MS, held.feedforward)

    np.testing.assert_allclose(simulated.state, held.state, rtol=1e-14)


@given(st.integers(1, 4), st.integers(1, 2), st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_a_random_plant_agrees_with_numerical_integration(n, m, seed):
    generator = np.random.default_rng(seed)
    a, b = generator.standard_normal((n, n)), generator.standard_normal((n, m))
    x0 = generator.standard_normal(n)
    steps = [(int(generator.integers(1, S)), generator.standard_normal(m)) for _ in range(3)]

    state = x0
    for duration_ns, u in steps:
        state = solve_ivp(
            lambda t, x, u=u: a @ x + b @ u,
            (0, duration_ns * 1e-9),
            state,
            method='DOP853',
            rtol=1e-12,
            atol=1e-13,
        ).y[:, -1]

    np.testing.assert_allclose(run(plant(a, b, x0), *steps), state, rtol=1e-9, atol=1e-10)


@given(st.integers(1, 10 * MS), st.integers(1, 10 * MS), st.integers(0, 2**32 - 1))
def test_two_steps_are_one_long_step(first_ns, second_ns, seed):
    generator = np.random.default_rng(seed)
    a, x0 = generator.standard_normal((3, 3)), generator.standard_normal(3)
    b = generator.standard_normal(3)

    split = run(plant(a, b, x0), (first_ns, 2), (second_ns, 2))
    whole = run(plant(a, b, x0), (first_ns + second_ns, 2))

    np.testing.assert_allclose(split, whole, rtol=1e-12, atol=1e-14)


def test_the_usual_step_is_no_special_case():
    usual, other = (plant([[1, 2], [3, 4]], [1, 0], [1, 1], period_ns=p) for p in (MS, 2 * MS))

    np.testing.assert_array_equal(run(usual, (MS, 1)), run(other, (MS, 1)))


def test_a_step_of_no_length_changes_nothing():
    assert run(plant(1, 1, [2]), (0, 5)) == [2]


@pytest.mark.parametrize(
    ('x0', 'period_ns', 'name'),
    [
        ([1, 2], MS, 'initial_state'),
        ([np.nan], MS, 'initial_state'),
        ([1], 0, 'sampling_period'),
        ([1], -1, 'sampling_period'),
    ],
)
def test_a_start_that_does_not_fit_is_refused(x0, period_ns, name):
    with pytest.raises(ParameterError) as caught:
        plant(1, 1, x0, period_ns=period_ns)
    assert caught.value.name == name
