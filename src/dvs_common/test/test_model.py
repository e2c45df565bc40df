"""Equilibria, modes in reach, scenes and reference bounds: hand cases and random plants."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from dvs_common.arrays import finite_array
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds

PAPER_A = np.array([[2.0, 10.0], [0.0, 5.0]])
PAPER_B = np.array([[1.0], [1.0]])
PAPER_C = np.array([2.0, 1.0]) / np.sqrt(5)


def plant(a, b, c=None):
    a = np.array(a, dtype=float)
    return PlantModel(
        state_matrix=a,
        input_matrix=np.array(b, dtype=float),
        output_vector=np.ones(len(a)) if c is None else np.array(c, dtype=float),
    )


def orthogonal(n, generator):
    return np.linalg.qr(generator.standard_normal((n, n)))[0]


# -- arrays ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'value', [[1.0, np.nan], [np.inf], ['a'], [[1.0]], 1.0, [1j], [10**400], None]
)
def test_an_array_that_is_not_a_finite_vector_is_refused_by_name(value):
    with pytest.raises(ParameterError, match=r'^gain = '):
        finite_array('gain', value, ndim=1)


def test_a_model_keeps_read_only_copies():
    a = PAPER_A.copy()
    model = plant(a, PAPER_B)
    a[0, 0] = 7

    assert model.state_matrix[0, 0] == 2
    with pytest.raises(ValueError, match='read-only'):
        model.state_matrix[0, 0] = 1


@pytest.mark.parametrize(
    ('changes', 'name'),
    [
        ({'state_matrix': np.eye(3)}, 'state_matrix'),
        ({'state_matrix': np.ones((2, 3))}, 'state_matrix'),
        ({'input_matrix': np.ones((3, 1))}, 'input_matrix'),
        ({'input_matrix': np.ones((2, 0))}, 'input_matrix'),
        ({'output_vector': np.zeros(2)}, 'output_vector'),
        ({'output_vector': np.empty(0)}, 'output_vector'),
    ],
)
def test_shapes_that_do_not_fit_are_refused(changes, name):
    fields = {'state_matrix': PAPER_A, 'input_matrix': PAPER_B, 'output_vector': PAPER_C}
    with pytest.raises(ParameterError) as caught:
        PlantModel(**{**fields, **changes})
    assert caught.value.name == name


# -- equilibrium ----------------------------------------------------------------------------------


def test_the_papers_set_point_is_projected_on_the_line_that_can_be_held():
    # A x lies in range(B) iff 2 x1 + 10 x2 = 5 x2: the line along (-0.5, 0.2).
    wanted = np.array([-0.2321, 0.0928])
    line = np.array([-0.5, 0.2])

    held = plant(PAPER_A, PAPER_B).equilibrium(wanted, tolerance=1e-3)

    np.testing.assert_allclose(held.state, line * (line @ wanted) / (line @ line), rtol=1e-12)
    np.testing.assert_allclose(held.state, [-0.232086, 0.092834], atol=1e-6)
    # (I - B B^+) (0.4638, 0.4640) = (-0.0001, 0.0001).
    assert held.residual == pytest.approx(1e-4 * np.sqrt(2), rel=1e-6)
    np.testing.assert_allclose(held.feedforward, [-5 * held.state[1]], rtol=1e-12)


def test_a_set_point_that_cannot_be_held_is_refused_with_the_nearest_one():
    with pytest.raises(ParameterError) as caught:
        plant(PAPER_A, PAPER_B).equilibrium([1.0, 1.0], tolerance=1e-3)
    # The projection of (1, 1) on (-0.5, 0.2) is 0.3 / 0.29 * (0.5, -0.2).
    assert '[0.517241379, -0.206896552]' in str(caught.value)
    assert 'residual 4.95 exceeds' in str(caught.value)


def test_a_stable_state_out_of_reach_must_be_zero():
    model = plant([[1, 0], [0, -1]], [[1], [0]])

    assert model.equilibrium([3, 0], tolerance=0).feedforward == pytest.approx([-3])
    with pytest.raises(ParameterError, match=r'nearest stabilizable set-point is \[3, 0\]'):
        model.equilibrium([3, 0.5], tolerance=0.1)
    np.testing.assert_allclose(model.equilibrium([3, 0.5], tolerance=1).state, [3, 0], atol=1e-12)


def test_a_constant_out_of_reach_must_be_zero_although_it_would_stay():
    # A x lies in range(B) for every x; only the first state can be reached from the origin.
    held = plant([[1, 0], [0, 0]], [[1], [0]]).equilibrium([2, 3], tolerance=3)

    np.testing.assert_allclose(held.state, [2, 0], atol=1e-12)
    assert held.residual == pytest.approx(3)


def test_any_position_of_a_double_integrator_can_be_held_and_no_speed():
    model = plant([[0, 1], [0, 0]], [[0], [1]])

    held = model.equilibrium([2.0, 0.3], tolerance=1)

    np.testing.assert_allclose(held.state, [2, 0], atol=1e-12)
    np.testing.assert_allclose(held.feedforward, [0], atol=1e-12)
    assert held.residual == pytest.approx(0.3)


@given(
    st.integers(1, 5),
    st.integers(1, 3),
    st.integers(0, 4),
    st.integers(0, 2**32 - 1),
)
def test_the_projection_is_held_by_the_feedforward_and_nothing_nearer_is(n, m, stable, seed):
    generator = np.random.default_rng(seed)
    stable = min(stable, n - 1)
    a = generator.standard_normal((n, n))
    b = generator.standard_normal((n, m))
    # The last states are out of reach, in rotated coordinates.
    a[n - stable :, : n - stable] = 0
    b[n - stable :] = 0
    rotation = orthogonal(n, generator)
    a, b = rotation @ a @ rotation.T, rotation @ b
    wanted = generator.standard_normal(n)

    held = plant(a, b).equilibrium(wanted, tolerance=1e9)

    unreachable = rotation[:, n - stable :].T
    np.testing.assert_allclose(a @ held.state + b @ held.feedforward, 0, atol=1e-8)
    np.testing.assert_allclose(unreachable @ held.state, 0, atol=1e-8)
    # What is missing is orthogonal to every point that can be held.
    constraints = np.vstack([(np.eye(n) - b @ np.linalg.pinv(b)) @ a, unreachable])
    multiplier = np.linalg.lstsq(constraints.T, wanted - held.state, rcond=1e-9)[0]
    np.testing.assert_allclose(constraints.T @ multiplier, wanted - held.state, atol=1e-7)


def test_without_an_input_only_an_equilibrium_is_held():
    model = plant([[1, 0], [0, 2]], [[0], [0]])

    np.testing.assert_array_equal(model.equilibrium([0, 0], tolerance=0).state, [0, 0])
    with pytest.raises(ParameterError, match='is not stabilizable'):
        model.equilibrium([1, 0], tolerance=0.1)


@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_a_set_point_that_can_be_held_is_left_alone(n, seed):
    generator = np.random.default_rng(seed)
    b = generator.standard_normal((n, n))
    wanted = generator.standard_normal(n)

    held = plant(generator.standard_normal((n, n)), b).equilibrium(wanted, tolerance=1e-6)

    np.testing.assert_allclose(held.state, wanted, rtol=1e-9, atol=1e-9)


# -- stabilizable and detectable ------------------------------------------------------------------

JORDAN = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
OSCILLATOR = np.array([[0.0, 2.0], [-2.0, 0.0]])


def blocks(*parts):
    n = sum(len(part) for part in parts)
    whole = np.zeros((n, n))
    at = 0
    for part in parts:
        whole[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return whole


CASES = {
    'paper': (PAPER_A, PAPER_B, True),
    'first mode only': (np.diag([2.0, 5.0]), [[1], [0]], False),
    'no input': (np.diag([2.0, -5.0]), [[0], [0]], False),
    'stable mode out of reach': (np.diag([2.0, -5.0]), [[1], [0]], True),
    'integrator out of reach': (np.diag([2.0, 0.0]), [[1], [0]], False),
    'twin modes, one input': (np.eye(2), [[1], [1]], False),
    'twin modes, two inputs': (np.eye(2), np.eye(2), True),
    'jordan chain from its end': (JORDAN, [[0], [0], [1]], True),
    'jordan chain from its middle': (JORDAN, [[0], [1], [0]], False),
    'jordan chain from its head': (JORDAN, [[1], [0], [0]], False),
    'stable jordan chain': (JORDAN - 3 * np.eye(3), [[1], [0], [0]], True),
    'oscillator in reach': (OSCILLATOR, [[0], [1]], True),
    'oscillator out of reach': (blocks([[1.0]], OSCILLATOR), [[1], [0], [0]], False),
    'damped oscillator out of reach': (
        blocks([[1.0]], OSCILLATOR - 0.1 * np.eye(2)),
        [[1], [0], [0]],
        True,
    ),
    'integrator chain': (np.diag(np.ones(4), 1), [[0], [0], [0], [0], [1]], True),
}


@pytest.mark.parametrize('name', CASES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
@example(seed=None)
def test_stabilizability_and_its_dual_whatever_the_coordinates(name, seed):
    a, b, stabilizable = CASES[name]
    b = np.array(b, dtype=float)
    if seed is not None:
        rotation = orthogonal(len(a), np.random.default_rng(seed))
        a, b = rotation @ a @ rotation.T, rotation @ b
    model = plant(a, b)

    if stabilizable:
        model.require_stabilizable()
    else:
        with pytest.raises(ParameterError, match='the plant is not stabilizable'):
            model.require_stabilizable()
    if b.shape[1] > 1 or not b.any():
        return
    dual = plant(a.T, np.ones((len(a), 1)), c=b[:, 0])
    if stabilizable:
        dual.require_detectable()
    else:
        with pytest.raises(ParameterError, match='the plant is not detectable'):
            dual.require_detectable()


@given(
    st.lists(st.sampled_from([-2.0, -0.5, 0.0, 0.5, 1.0, 3.0]), min_size=1, max_size=4),
    st.data(),
    st.integers(0, 2**32 - 1),
)
def test_a_diagonal_plant_is_stabilizable_iff_its_unstable_modes_are_reached(modes, data, seed):
    # The Gramian of (A, b) restricted to the unstable modes of a diagonal A is regular iff these
    # differ and b reaches each of them.
    reached = data.draw(st.lists(st.booleans(), min_size=len(modes), max_size=len(modes)))
    rotation = orthogonal(len(modes), np.random.default_rng(seed))
    unstable = [mode for mode in modes if mode >= 0]
    expected = len(set(unstable)) == len(unstable) and all(
        r for r, mode in zip(reached, modes, strict=True) if mode >= 0
    )
    model = plant(rotation @ np.diag(modes) @ rotation.T, rotation @ np.array(reached)[:, None])

    if expected:
        model.require_stabilizable()
    else:
        with pytest.raises(ParameterError, match='out of reach'):
            model.require_stabilizable()


def test_the_message_names_the_mode():
    with pytest.raises(ParameterError, match=r's = 5\+0j'):
        plant(np.diag([2.0, 5.0]), [[1], [0]]).require_stabilizable()


# -- scene ----------------------------------------------------------------------------------------


def test_luminosity_is_affine_in_the_state():
    model = plant(PAPER_A, PAPER_B, PAPER_C)
    offsets = np.array([[0.0, 0.0], [0.01, 0.0], [-0.01, 0.02]])
    scene = PixelScene.from_offsets(model, offsets, height=1, width=3)
    state = np.array([0.3, -0.2])

    expected = [PAPER_C @ (state + offset) for offset in offsets]

    np.testing.assert_allclose(scene.luminosity(model, state), expected, rtol=1e-14)
    assert scene.pixel_count == 3


@pytest.mark.parametrize(('height', 'width'), [(1, 2), (2, 2), (0, 3), (-1, -3)])
def test_a_grid_that_does_not_hold_the_pixels_is_refused(height, width):
    with pytest.raises(ParameterError, match='hold the 3 pixels'):
        PixelScene(brightness_offsets=np.zeros(3), height=height, width=width)


def test_offsets_need_an_entry_for_every_state():
    with pytest.raises(ParameterError, match='must have 2 columns'):
        PixelScene.from_offsets(plant(PAPER_A, PAPER_B), np.zeros((3, 3)), height=1, width=3)


# -- reference bounds -----------------------------------------------------------------------------


@given(
    st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=5).map(np.array),
    st.floats(0, 0.999),
    st.sampled_from([-1.0, 1.0]),
)
def test_bounds_around_a_luminosity_contain_its_magnitude(luminosity, share, sign):
    uncertainty = share * luminosity.min()
    assume(uncertainty < luminosity.min())

    bounds = ReferenceBounds.around(sign * luminosity, uncertainty)

    np.testing.assert_allclose(bounds.lower, luminosity - uncertainty)
    np.testing.assert_allclose(bounds.upper, luminosity + uncertainty)
    assert np.all(bounds.lower > 0)


@pytest.mark.parametrize(
    ('luminosity', 'uncertainty', 'reason'),
    [
        ([0.5, 0.1], 0.1, 'pixel 1 starts at 0.1'),
        ([0.5, 0.0], 0.0, 'pixel 1 starts at 0'),
        ([0.5], -0.1, 'must be >= 0'),
        ([0.5], np.nan, 'must be >= 0'),
        ([np.nan], 0.1, 'must be finite'),
    ],
)
def test_bounds_that_would_not_be_positive_are_refused(luminosity, uncertainty, reason):
    with pytest.raises(ParameterError, match=reason):
        ReferenceBounds.around(luminosity, uncertainty)


@pytest.mark.parametrize(
    ('lower', 'upper', 'reason'),
    [
        ([1.0, 0.0], [1.0, 1.0], r'must be > 0 \(pixel 1'),
        ([1.0, 2.0], [1.0, 1.9], r'must not exceed reference_upper = 1.9 \(pixel 1'),
        ([1.0], [1.0, 2.0], r'as many entries as reference_upper \(2\)'),
        ([1.0], [np.inf], 'must be finite'),
    ],
)
def test_bounds_in_the_wrong_order_are_refused(lower, upper, reason):
    with pytest.raises(ParameterError, match=reason):
        ReferenceBounds(lower=lower, upper=upper)
