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
    steep_directions,
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


@pytest.mark.parametrize(('vectors', 'directions'), [(7, 0), (7, 3), (9000, 5), (40_001, 1)])
def test_sums_by_parts_are_those_of_the_whole(vectors, directions):
    generator = np.random.default_rng(vectors)
    values, weights = generator.normal(size=(vectors, 3)), generator.uniform(size=vectors)
    v = generator.normal(size=(3, directions))

    found = WeightedVectors(values=values, weights=weights).integral(v)
    np.testing.assert_allclose(found, weights @ np.abs(values @ v), rtol=1e-12)


@pytest.mark.parametrize('n', [3, 6])
def test_of_many_vectors_the_steepest_direction_is_found_by_a_part_of_them(n):
    """A decaying, turning kernel: with all vectors at every step no larger integral is found."""
    generator = np.random.default_rng(n)
    times = np.linspace(0, 8, 30_000)[:, None]
    values = np.exp(-times) * np.cos(
        times * generator.uniform(0.5, 6, n) + generator.normal(size=n)
    )
    kernel = WeightedVectors(values=values, weights=np.full(len(times), 8 / 30_000))

    best = kernel.integral(steep_directions(kernel))[0]
    v = generator.normal(size=(n, 60))
    for _ in range(60):
        v /= np.linalg.norm(v, axis=0)
        reached = kernel.integral(v).max()
        v = values.T @ np.sign(values @ v)
    assert best >= reached * (1 - 1e-6)
