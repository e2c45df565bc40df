"""Bounds of the largest integral over all directions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_hinf_controller.analysis.directions import (
    WeightedVectors,
    largest_bound,
    largest_integral,
    lengths_of,
)


def alike(seed: int, n: int):
    """Three kernels that differ little, and weights."""
    generator = np.random.default_rng(seed)
    first = generator.normal(size=(40, n)) * generator.uniform(0.01, 3, size=(40, 1))
    changes = 1 + 0.02 * generator.normal(size=(3, 40, n))
    return first * changes, generator.uniform(0, 1, size=40)


@given(seed=st.integers(0, 2**31), n=st.integers(1, 5))
def test_the_bound_of_some_kernels_is_never_exceeded_and_hardly_above_that_of_each(seed, n):
    values, weights = alike(seed, n)
    brackets = [largest_integral(WeightedVectors(values=v, weights=weights)) for v in values]

    bound = largest_bound(values, weights)

    directions = np.random.default_rng(seed).normal(size=(n, 200))
    directions /= np.linalg.norm(directions, axis=0)
    sums = [WeightedVectors(values=v, weights=weights).integral(directions).max() for v in values]
    rounding = 1 + 1e-12
    assert max(sums) <= bound * rounding
    assert max(bracket.lower for bracket in brackets) <= bound * rounding
    assert bound <= max(bracket.upper for bracket in brackets) * 1.01


def test_a_direction_that_all_vectors_have_gives_the_bound_itself():
    along = np.array([0.6, 0.0, 0.8])
    values = np.array([[[1.0], [3.0]], [[2.0], [1.0]]]) * along

    assert largest_bound(values, np.array([2.0, 0.5])) == pytest.approx(4.5, rel=1e-3)


def test_lengths_are_those_of_numpy():
    vectors = np.random.default_rng(1).normal(size=(3, 7, 4))

    np.testing.assert_allclose(lengths_of(vectors), np.linalg.norm(vectors, axis=-1), rtol=1e-15)
