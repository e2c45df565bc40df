"""Response to a held input against SciPy's exponential, closed forms and 50 digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from dvs_hinf_controller.running.held_input import MANY_JUMPS, HeldInputResponse

DURATIONS = np.array([0.0, 1e-9, 1e-3, 0.37])


def by_expm(a, b, duration):
    k = len(b)
    augmented = np.zeros((k + 1, k + 1))
    augmented[:k, :k], augmented[:k, k] = a, b
    step = expm(augmented * duration)
    return step[:k, :k], step[:k, k]


def assert_agrees(a, b, durations=DURATIONS, rtol=1e-9):
    response = HeldInputResponse(a, b)
    scale = np.abs(b).max(initial=1e-300)
    found = response.response(durations)
    assert found.shape == (len(durations), len(b))
    for row, duration in zip(found, durations, strict=True):
        transition, gain = by_expm(a, b, duration)
        np.testing.assert_allclose(row, gain, rtol=rtol, atol=rtol * scale * duration)
        np.testing.assert_allclose(
            response.transition(duration), transition, rtol=rtol, atol=rtol * 10
        )


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_the_response_of_random_systems_is_the_matrix_exponential(k, seed):
    generator = np.random.default_rng(seed)

    assert_agrees(generator.standard_normal((k, k)), generator.standard_normal(k))


JORDAN = np.array([[-2.0, 1.0, 0.0], [0.0, -2.0, 1.0], [0.0, 0.0, -2.0]])


@pytest.mark.parametrize(
    'a',
    [
        JORDAN,
        np.diag([1.0, 1.0], 1),
        np.zeros((2, 2)),
        np.array([[0.0, 3.0], [-3.0, 0.0]]),
        np.diag([0.0, -1.0, -5.0]),
        np.array([[-1.0, 1.0], [0.0, -1.0 - 1e-9]]),
    ],
    ids=['defective', 'integrators', 'zero', 'oscillator', 'pole at zero', 'nearly defective'],
)
def test_special_systems_in_any_coordinates(a):
    b = np.arange(1.0, len(a) + 1)
    assert_agrees(a, b)
    rotation = np.linalg.qr(np.random.default_rng(1).standard_normal(a.shape))[0]
    assert_agrees(rotation @ a @ rotation.T, rotation @ b)


@pytest.mark.parametrize(
    'a',
    [
        JORDAN,
        np.diag([0.0, -1.0, -5.0]),
        np.array([[-1.0, 30.0, 1.0], [-30.0, -1.0, 0.0], [0.0, 1.0, -2.0]]),
    ],
    ids=['defective', 'pole at zero', 'oscillator'],
)
@pytest.mark.parametrize('count', [3, MANY_JUMPS])
def test_what_many_jumps_lead_to_is_the_sum_of_what_each_does(a, count):
    random = np.random.default_rng(0)
    jumps, durations = random.standard_normal(count), random.uniform(0, 0.4, count)
    response = HeldInputResponse(a, np.arange(1.0, len(a) + 1))

    found = response.jumped(jumps, durations)

    each = response.response(durations)
    scale = np.abs(jumps) @ np.abs(each)
    assert np.all(np.abs(found - jumps @ each) <= 1e-14 * count**0.5 * scale)


def test_poles_six_decades_apart_keep_twelve_digits():
    # Near-optimal controllers have poles from -2 to -1e6; the reference has 50 digits.
    poles = [-2.0, -3e3, -1e6]
    vectors = np.array([[1.0, 2.0, 0.5], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    a = vectors @ np.diag(poles) @ np.linalg.inv(vectors)
    b = np.array([1.0, -2.0, 3.0])
    found = HeldInputResponse(a, b).response(np.array([1e-7, 1e-3, 2.0]))

    with mpmath.workdps(50):
        for row, t in zip(found, ('1e-7', '1e-3', '2.0'), strict=True):
            v = mpmath.matrix(vectors.tolist())
            modal = mpmath.lu_solve(v, mpmath.matrix(b.tolist()))
            grown = [
                (mpmath.expm1(p * mpmath.mpf(t)) / p) * w
                for p, w in zip(poles, modal, strict=True)
            ]
            expected = np.array([float(x) for x in v * mpmath.matrix(grown)])
            np.testing.assert_allclose(row, expected, rtol=1e-9)


@given(st.floats(1e-9, 1.0), st.integers(0, 2**32 - 1))
def test_the_response_of_a_sum_of_times_is_transition_and_response(t, seed):
    generator = np.random.default_rng(seed)
    system = HeldInputResponse(generator.standard_normal((3, 3)), generator.standard_normal(3))
    first, second, whole = system.response(np.array([t, 2 * t, 3 * t]))

    np.testing.assert_allclose(
        system.transition(2 * t) @ first + second, whole, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize('a', [JORDAN, -np.eye(2)], ids=['defective', 'modal'])
def test_no_instants_give_no_rows(a):
    assert HeldInputResponse(a, np.ones(len(a))).response(np.empty(0)).shape == (0, len(a))


def test_a_static_gain_has_no_state():
    static = HeldInputResponse(np.zeros((0, 0)), np.zeros(0))

    assert static.transition(0.5).shape == (0, 0)
    assert static.response(np.array([0.1, 0.2])).shape == (2, 0)
    assert static.response(np.empty(0)).shape == (0, 0)
