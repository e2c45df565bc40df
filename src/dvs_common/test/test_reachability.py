"""Unstable modes out of reach: Jordan chains, integrators, and states in any unit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.scenario.reachability import has_full_column_rank, unreachable_unstable_mode


def jordan(mode, size):
    return mode * np.eye(size) + np.diag(np.ones(size - 1), 1)


def unit(size, place):
    return np.eye(size)[:, [place]]


PAIRS = {
    'jordan chain from its end': (jordan(1.0, 3), unit(3, 2), True),
    'jordan chain from its middle': (jordan(1.0, 3), unit(3, 1), False),
    'jordan chain of five from its head': (jordan(0.5, 5), unit(5, 0), False),
    'five integrators from their end': (jordan(0.0, 5), unit(5, 4), True),
    'five integrators from the fourth': (jordan(0.0, 5), unit(5, 3), False),
    'two equal integrators, one input': (np.zeros((2, 2)), np.ones((2, 1)), False),
    'stable jordan chain': (jordan(-2.0, 3), unit(3, 0), True),
    'paper': (np.array([[2.0, 10.0], [0.0, 5.0]]), np.ones((2, 1)), True),
    'hidden unstable sum': (
        np.array([[-1.0, 2.0], [2.0, -1.0]]),
        np.array([[1.0], [-1.0]]),
        False,
    ),
    'no input': (np.eye(2), np.zeros((2, 1)), False),
    'no input, stable': (-np.eye(2), np.zeros((2, 1)), True),
}


@pytest.mark.parametrize('name', PAIRS)
@given(
    exponents=st.lists(st.floats(-6, 6), min_size=5, max_size=5),
    seconds=st.sampled_from([1e-6, 1.0, 1e6]),
    amplitude=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_the_answer_is_the_same_in_any_units(name, exponents, seconds, amplitude):
    a, b, reached = PAIRS[name]
    scale = 10.0 ** np.array(exponents[: len(a)])
    scaled = seconds * a * scale[:, None] / scale

    mode = unreachable_unstable_mode(scaled, amplitude * scale[:, None] * b)

    assert (mode is None) is reached


@given(
    seed=st.integers(0, 2**32 - 1), exponents=st.lists(st.floats(-6, 6), min_size=6, max_size=6)
)
def test_a_random_plant_is_reached_and_an_unstable_block_set_aside_is_found(seed, exponents):
    generator = np.random.default_rng(seed)
    scale = 10.0 ** np.array(exponents)
    a = generator.standard_normal((6, 6))
    b = generator.standard_normal((6, 2))
    a[4:, :4], b[4:], a[4:, 4:] = 0, 0, [[0.1, 1.0], [-1.0, 0.1]]

    mode = unreachable_unstable_mode(a * scale[:, None] / scale, b * scale[:, None])
    inside = unreachable_unstable_mode(
        a[:4, :4] * scale[:4, None] / scale[:4], b[:4] * scale[:4, None]
    )

    assert mode is not None
    assert (mode.real, abs(mode.imag)) == pytest.approx((0.1, 1.0), rel=1e-6)
    assert inside is None


@pytest.mark.parametrize(
    ('matrix', 'full'),
    [
        (np.eye(3)[:, :2], True),
        (np.array([[1.0, 1e-8], [0.0, 1e-8]]), True),
        (np.array([[1.0, 1.0], [2.0, 2.0 + 1e-12]]), False),
        (np.array([[1.0, 1.0j], [1.0j, -1.0]]), False),
        (1e-200 * np.eye(2), True),
        (np.zeros((2, 1)), False),
        (np.ones((1, 2)), False),
        (np.zeros((2, 0)), True),
    ],
)
def test_columns_are_of_full_rank_where_none_is_a_sum_of_others(matrix, full):
    assert has_full_column_rank(matrix) is full


def test_a_scale_decides_what_is_small():
    assert has_full_column_rank(1e-8 * np.eye(2), scale=1.0)
    assert not has_full_column_rank(1e-10 * np.eye(2), scale=1.0)
