"""The interior-point method against a general solver of linear programs."""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_hinf_controller.synthesis.least_l1 import L1Problem, least_l1
from dvs_hinf_controller.synthesis.synthesis_error import SynthesisError


def drawn(seed: int, *, equations: int = 0) -> L1Problem:
    """A problem of 1 to 4 directions, 20 nodes and 1 to 6 coefficients."""
    rng = np.random.default_rng(seed)
    directions, k = rng.integers(1, 5), int(rng.integers(max(1, equations), 7))
    return L1Problem(
        slopes=rng.standard_normal((1 + directions, 20, k)) * 10 ** rng.uniform(-3, 3, k),
        offsets=rng.standard_normal((1 + directions, 20)),
        weights=10 ** rng.uniform(-2, 1, 20),
        equal_slope=rng.standard_normal((equations, k)),
        equal_offset=rng.standard_normal(equations),
    )


def objective(problem: L1Problem, theta: np.ndarray) -> float:
    sizes = np.abs(problem.slopes @ theta + problem.offsets) @ problem.weights
    return float(sizes[0] + sizes[1:].max())


def optimum(problem: L1Problem) -> float:
    """The same by HiGHS, with a bound of every residual as an unknown."""
    rows, nodes, k = problem.slopes.shape
    total = rows * nodes
    slopes, offsets = problem.slopes.reshape(total, k), problem.offsets.ravel()
    sums = np.kron(np.eye(rows)[1:], problem.weights)
    result = scipy.optimize.linprog(
        np.concatenate([np.zeros(k), np.kron(np.eye(rows)[0], problem.weights), [1.0]]),
        A_ub=np.block(
            [
                [slopes, -np.eye(total), np.zeros((total, 1))],
                [-slopes, -np.eye(total), np.zeros((total, 1))],
                [np.zeros((rows - 1, k)), sums, -np.ones((rows - 1, 1))],
            ]
        ),
        b_ub=np.concatenate([-offsets, offsets, np.zeros(rows - 1)]),
        A_eq=np.hstack([problem.equal_slope, np.zeros((len(problem.equal_slope), total + 1))]),
        b_eq=-problem.equal_offset,
        bounds=[(None, None)] * (k + total + 1),
    )
    return float(result.fun)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), equations=st.integers(0, 2))
def test_its_objective_is_that_of_a_general_solver(seed: int, equations: int) -> None:
    problem = drawn(seed, equations=equations)
    theta = least_l1(problem)
    assert objective(problem, theta) == pytest.approx(optimum(problem), rel=2e-5)
    np.testing.assert_allclose(
        problem.equal_slope @ theta, -problem.equal_offset, rtol=0, atol=1e-6
    )


def test_a_median_is_found() -> None:
    problem = L1Problem(
        slopes=np.ones((2, 3, 1)),
        offsets=-np.array([[0.0, 1.0, 5.0]] * 2),
        weights=np.ones(3),
        equal_slope=np.zeros((0, 1)),
        equal_offset=np.zeros(0),
    )
    assert least_l1(problem) == pytest.approx([1.0], abs=1e-3)


def test_rounding_that_stops_it_far_from_the_optimum_is_named() -> None:
    problem = L1Problem(
        slopes=np.full((2, 3, 1), np.nan),
        offsets=np.ones((2, 3)),
        weights=np.ones(3),
        equal_slope=np.zeros((0, 1)),
        equal_offset=np.zeros(0),
    )
    with pytest.raises(SynthesisError, match='duality gap'):
        least_l1(problem)
