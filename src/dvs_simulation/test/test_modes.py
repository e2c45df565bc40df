import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_simulation.exact.modes import modal_form


def block_matrix(form):
    blocks = [np.array([[pole]]) for pole in form.real_poles]
    for decay, frequency in zip(form.pair_decay, form.pair_frequency, strict=True):
        blocks.append(np.array([[decay, frequency], [-frequency, decay]]))
    return scipy.linalg.block_diag(*blocks, *form.dense_blocks)


def residual(matrix):
    form = modal_form(matrix)
    back = form.extended_basis @ block_matrix(form).astype(np.longdouble) @ form.inverse
    return form, float(np.max(np.abs(back - matrix)))


JORDAN = np.array([[-1.0, 1, 0], [0, -1, 1], [0, 0, -1]])


@pytest.mark.parametrize(
    ('matrix', 'dense'),
    [
        (np.array([[2.0, 10], [0, 5]]), []),
        (np.zeros((2, 2)), []),
        (np.array([[0.0, 1], [0, 0]]), [2]),
        (JORDAN, [3]),
        (np.diag([-1.0, -1, -2]), []),
        (np.array([[-1.0, 1], [-1e-16, -1]]), [2]),
        (scipy.linalg.block_diag(JORDAN, -1e6), [3]),
        (np.kron(np.array([[1.0, 1], [0, 1]]), np.array([[-1.0, 2], [-2, -1]])), []),
    ],
)
def test_defective_poles_stay_together_and_the_form_is_exact(matrix, dense):
    form, error = residual(matrix)
    if dense:
        assert [len(block) for block in form.dense_blocks] == dense
    assert error <= 4e-16 * max(1.0, np.linalg.norm(matrix))


def test_slow_poles_keep_all_digits_beside_fast_ones():
    rng = np.random.default_rng(3)
    poles = np.array([-2.0, -3.0, -1e3, -1e6])
    # Fractions of powers of two: the similarity is exact in floating point.
    matrix = np.diag(poles) + np.triu(rng.integers(-99, 99, (4, 4)) / 8, 1)
    mixing = np.array([[1, 0, 0, 0], [0.5, 1, 0, 0], [0.25, 0.5, 1, 0], [0.5, 0.25, 0.5, 1]])
    inverse = np.linalg.inv(mixing)
    form = modal_form(mixing @ matrix @ inverse)
    np.testing.assert_allclose(np.sort(form.real_poles), np.sort(poles), rtol=1e-15)


def test_fast_coupling_between_near_poles_is_not_split():
    form, error = residual(np.array([[-1.0, 1e3], [0, -1 - 1e-6]]))
    assert [len(block) for block in form.dense_blocks] == [2]
    assert error < 1e-12


@given(st.integers(1, 7), st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_any_matrix_is_reproduced(n, seed):
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((n, n)) * 10.0 ** rng.integers(-2, 3)
    _, error = residual(matrix)
    assert error <= 1e-13 * np.linalg.norm(matrix)


@pytest.mark.parametrize('matrix', [np.zeros((2, 3)), np.array([[np.nan]]), np.zeros((0, 0))])
def test_bad_matrices_are_named(matrix):
    with pytest.raises(ParameterError, match='matrix'):
        modal_form(matrix)
