"""The matrices of a controller: shapes, and the frequency response against the formula."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_hinf_controller.controller import LinearController


def controller(k, m, seed=0):
    generator = np.random.default_rng(seed)
    return LinearController(
        state_matrix=generator.standard_normal((k, k)) - 3 * np.eye(k),
        input_vector=generator.standard_normal(k),
        output_matrix=generator.standard_normal((m, k)),
        feedthrough=generator.standard_normal(m),
    )


@given(st.integers(0, 4), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_the_response_is_that_of_its_matrices(k, m, seed):
    found = controller(k, m, seed)
    w = np.array([0.0, 0.3, 10.0])

    expected = [
        found.output_matrix
        @ np.linalg.inv(1j * f * np.eye(k) - found.state_matrix)
        @ found.input_vector
        + found.feedthrough
        for f in w
    ]

    np.testing.assert_allclose(found.response(w), expected, rtol=1e-9, atol=1e-12)
    assert (found.order, found.input_count) == (k, m)


def test_a_first_order_lag_by_hand():
    lag = LinearController(
        state_matrix=[[-2.0]], input_vector=[3.0], output_matrix=[[5.0]], feedthrough=[7.0]
    )

    np.testing.assert_allclose(lag.response(np.array([2.0])), [[15 / (2 + 2j) + 7]])


@pytest.mark.parametrize(
    'change',
    [
        {'state_matrix': np.zeros((2, 3))},
        {'state_matrix': np.zeros((3, 3))},
        {'input_vector': np.zeros(3)},
        {'output_matrix': np.zeros((2, 2))},
        {'feedthrough': np.zeros(2)},
        {'feedthrough': np.array([np.nan])},
        {'feedthrough': 1.0},
    ],
    ids=str,
)
def test_shapes_that_do_not_fit_are_refused(change):
    fields = {
        'state_matrix': np.zeros((2, 2)),
        'input_vector': np.zeros(2),
        'output_matrix': np.zeros((1, 2)),
        'feedthrough': np.zeros(1),
    }
    LinearController(**fields)
    with pytest.raises(ParameterError):
        LinearController(**{**fields, **change})


def test_python_control_gets_the_same_system():
    found = controller(3, 2)
    w = np.array([0.1, 1.0, 10.0])

    system = found.state_space()

    assert (system.ninputs, system.noutputs, system.nstates) == (1, 2, 3)
    response = np.array([system(1j * f)[:, 0] for f in w])
    np.testing.assert_allclose(response, found.response(w), rtol=1e-9)
