"""The fast path of a step gives the bits of the general one, or leaves everything to it."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.wire.messages import Vector, pack_command, pack_image
from dvs_plant_sim.plant import Plant
from dvs_plant_sim.small_step import LARGEST_INPUT, SmallStep

MS = 1_000_000
numbers = st.floats(-10.0, 10.0, allow_subnormal=False)


def command(stamp_ns, *values, names=('u1',)):
    return pack_command(Vector(stamp_ns=stamp_ns, names=names, values=np.array(values)))


def model_of(rng, states):
    return PlantModel(
        state_matrix=rng.standard_normal((states, states)),
        input_matrix=rng.standard_normal((states, 1)),
        output_vector=rng.standard_normal(states),
    )


def loop_of(seed, states, pixels, *, disturbance=0.0, needs_light=False):
    rng = np.random.default_rng(seed)
    model = model_of(rng, states)
    plant = Plant(model, initial_state=rng.standard_normal(states), period_ns=MS)
    scene = PixelScene(brightness_offsets=rng.standard_normal(pixels), height=1, width=pixels)
    step = SmallStep(
        plant,
        model,
        scene,
        input_names=('u1',),
        output_disturbance=disturbance,
        needs_light=needs_light,
    )
    return model, plant, scene, step


@given(
    seed=st.integers(0, 2**32 - 1),
    states=st.integers(1, 7),
    pixels=st.integers(1, 32),
    disturbance=st.sampled_from([0.0, 0.013]),
    inputs=st.lists(numbers, min_size=1, max_size=8),
)
@settings(max_examples=200, deadline=None)
def test_states_and_images_are_those_of_the_general_path_to_the_bit(
    seed, states, pixels, disturbance, inputs
):
    assume(all(inputs))
    model, plant, scene, step = loop_of(seed, states, pixels, disturbance=disturbance)
    other = Plant(model, initial_state=plant.state, period_ns=MS)
    for k, u in enumerate(inputs):
        step.prepare(k * MS)
        image = step.image_after(command(k * MS, u))
        other.advance(MS, np.array([u]))
        seen = scene.luminosity(model, other.state) + disturbance
        assert image == pack_image((k + 1) * MS, seen.reshape(1, -1), '64FC1')
        assert plant.state.tobytes() == other.state.tobytes()


@pytest.mark.parametrize(
    'message',
    [
        command(2 * MS, 1.0),
        command(MS, 1.0, names=('v1',)),
        command(MS, 1.0, 1.0, names=('u1', 'u2')),
        command(MS, 1.0) + b'\0',
        command(MS, 1.0)[:-1],
        command(MS, 0.0),
        command(MS, -0.0),
        command(MS, math.nan),
        command(MS, math.inf),
        command(MS, LARGEST_INPUT),
        b'',
    ],
    ids=repr,
)
def test_any_other_command_is_left_to_the_general_path(message):
    _, plant, _, step = loop_of(0, 2, 9)
    before = plant.state
    step.prepare(MS)

    assert step.image_after(message) is None
    assert plant.state is before


def test_a_preparation_serves_for_one_command():
    _, plant, _, step = loop_of(0, 2, 9)
    assert step.image_after(command(0, 1.0)) is None
    step.prepare(MS)
    assert step.image_after(command(MS, 1.0)) is not None
    after = plant.state

    assert step.image_after(command(MS, 1.0)) is None
    assert plant.state is after


def test_a_luminosity_that_is_not_positive_is_left_to_the_general_path_where_pixels_need_light():
    for needs_light in (False, True):
        _, plant, scene, step = loop_of(0, 2, 9, needs_light=needs_light)
        before = plant.state
        step.prepare(0)
        image = step.image_after(command(0, 1.0))
        assert (image is None) == (plant.state is before) == needs_light
        assert scene.brightness_offsets.min() < 0


@pytest.mark.parametrize('beyond', [1e308, -1e308])
def test_a_state_beyond_all_numbers_is_left_to_the_general_path(beyond):
    _, plant, _, step = loop_of(0, 2, 9)
    plant.state = np.array([beyond, beyond])
    step.prepare(0)

    assert step.image_after(command(0, 1.0)) is None


def test_it_fits_one_input_and_few_pixels_of_one_group_on_a_straight_line():
    model, _, scene, _ = loop_of(0, 2, 32)
    many = PixelScene(brightness_offsets=np.zeros(33), height=1, width=33)
    grouped = dataclasses.replace(scene, groups=np.zeros(32, np.intp))
    two = PlantModel(
        state_matrix=model.state_matrix, input_matrix=np.eye(2), output_vector=np.ones(2)
    )

    assert SmallStep.fits(model, scene)
    assert not SmallStep.fits(model, many)
    assert not SmallStep.fits(model, grouped)
    assert not SmallStep.fits(two, scene)
