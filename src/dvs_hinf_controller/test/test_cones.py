"""An upper bound over the unit sphere, against norms whose largest value is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_hinf_controller.analysis.cones import largest_on_sphere
from dvs_hinf_controller.analysis.directions import WeightedVectors, largest_integral

RTOL = 2e-3


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 4))
def test_it_is_a_bound_and_a_tight_one_for_a_sum_of_few_vectors(seed: int, n: int) -> None:
    """``max_v sum |v'g|`` is the longest of all sums ``+-g``."""
    vectors = np.random.default_rng(seed).standard_normal((7, n))
    signs = np.array(np.meshgrid(*[[-1, 1]] * 7)).reshape(7, -1).T
    largest = float(np.linalg.norm(signs @ vectors, axis=1).max())
    found = largest_on_sphere(
        lambda v: np.abs(vectors @ v).sum(axis=0), n, lower=0.0, rtol=RTOL, most=10**6
    )
    assert largest * (1 - 1e-12) <= found <= largest * (1 + RTOL)


def test_few_cones_are_a_bound_too() -> None:
    shape = np.diag([1.0, 2.0, 5.0])

    def norm(v: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(shape @ v, axis=0))

    found = [largest_on_sphere(norm, 3, lower=0.0, rtol=RTOL, most=most) for most in (4, 40, 4000)]
    assert min(found) >= 5.0
    assert found[2] == pytest.approx(5.0, rel=RTOL)


@pytest.mark.parametrize('n', [1, 2, 3, 4])
def test_the_bracket_of_a_peak_gain_is_narrow_up_to_four_states(n: int) -> None:
    rng = np.random.default_rng(n)
    kernel = WeightedVectors(values=rng.standard_normal((50, n)), weights=rng.uniform(0, 1, 50))
    bracket = largest_integral(kernel)
    assert bracket.lower <= bracket.upper <= bracket.lower * (1 + RTOL)
