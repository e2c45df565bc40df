"""Brightness profiles: their line, its error, and the files and functions that they come from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from dvs_common.errors import ParameterError
from dvs_common.scenario.brightness_profile import BrightnessProfile
from dvs_common.scenario.profile_file import read_profile
from dvs_common.scenario.scenario import Scenario, load_scenario


@st.composite
def profiles(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(2, 12))
    positions = np.cumsum(rng.uniform(0.01, 1.0, count))
    luminosities = np.cumsum(rng.uniform(0.05, 1.0, count))
    return positions, luminosities[:: draw(st.sampled_from([1, -1]))]


@settings(max_examples=150, deadline=None)
@given(profiles(), st.floats(0.05, 0.95), st.floats(0.1, 1.0), st.integers(1, 4))
def test_the_profile_stays_within_the_error_of_its_line(knots, where, share, pixels):
    profile = BrightnessProfile(positions=knots[0], luminosities=knots[1])
    start, end = profile.positions[[0, -1]]
    targets = start + (end - start) * np.clip(where + 0.01 * np.arange(pixels), 0.05, 0.95)
    room = min(targets.min() - start, end - targets.max())
    line = profile.line_around(targets, reach=share * room)

    moved = np.concatenate(
        [np.linspace(-line.reach, line.reach, 401), *(profile.positions - t for t in targets)]
    )
    moved = moved[np.abs(moved) <= line.reach]
    seen = profile.luminosity(targets[:, None] + moved) - profile.luminosity(targets)[:, None]
    size = np.abs(line.slope * moved)
    missed = np.abs(seen - line.slope * moved)
    assert np.all(missed <= line.slope_error * size * (1 + 1e-9) + 1e-12)
    steps = np.abs(np.diff(profile.luminosity(targets[:, None] + np.sort(moved)), axis=1))
    allowed = line.steepness * abs(line.slope) * np.diff(np.sort(moved))
    assert np.all(steps <= allowed * (1 + 1e-9) + 1e-12)


def test_the_line_is_the_best_that_the_secants_allow():
    """A tent of slopes 1 and 3 about its knot: secants from there have these slopes alone."""
    profile = BrightnessProfile(positions=[0, 1, 2], luminosities=[1, 2, 5])
    line = profile.line_around(np.array([1.0]))

    assert (line.slope, line.slope_error, line.steepness) == (2.0, 0.5, 1.5)
    assert line.reach == 1.0


def test_a_secant_is_taken_at_the_end_of_the_reach_not_of_the_profile():
    profile = BrightnessProfile(positions=[0, 1, 2, 3], luminosities=[1, 2, 3, 6])
    assert profile.line_around(np.array([1.0]), reach=1.0).slope_error == 0
    # From 1.5 the last stretch has the slope 3 for half of the reach: (3 + 0.5) / 1 at its end.
    line = profile.line_around(np.array([1.5]), reach=1.0)
    assert line.slope == pytest.approx((1 + 2) / 2)
    assert line.slope_error == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ('positions', 'luminosities', 'message'),
    [
        ([0.0], [1.0], 'at least two positions'),
        ([0.0, 1.0], [1.0], 'at least two positions'),
        ([0.0, 0.0], [1.0, 2.0], 'positions that increase'),
        ([0.0, 1.0], [1.0, 0.0], 'must be > 0 everywhere, and is not at the position 1'),
        ([0.0, float('nan')], [1.0, 1.0], 'brightness_profile'),
    ],
)
def test_knots_that_are_no_profile_are_refused(positions, luminosities, message):
    with pytest.raises(ParameterError, match=message):
        BrightnessProfile(positions=positions, luminosities=luminosities)


@pytest.mark.parametrize(
    ('at', 'reach', 'message'),
    [
        (5.0, 0.0, 'must be seen within brightness_profile'),
        (0.5, 1.0, 'profile_reach = 1.0: must not exceed 0.5'),
        (1.0, 0.0, 'must rise all along'),
    ],
)
def test_a_set_point_without_a_line_is_refused(at, reach, message):
    hill = BrightnessProfile(positions=[0, 1, 2], luminosities=[1, 2, 1])
    with pytest.raises(ParameterError, match=message):
        hill.line_around(np.array([at]), reach=reach)


def test_beyond_its_ends_a_profile_keeps_their_luminosity():
    profile = BrightnessProfile(positions=[0, 1], luminosities=[1, 2])
    assert profile.luminosity(np.array([-9.0, 9.0])).tolist() == [1, 2]
    assert profile.covers(np.array([0.0, 1.0])) and not profile.covers(np.array([0.0, 1.01]))


def test_a_table_is_read_with_its_heading_comments_and_any_separator(tmp_path):
    table = tmp_path / 'wall.csv'
    table.write_text('position,luminosity\n# measured\n0, 1\n\n1;2\n2\t4 # end\n')
    profile = read_profile(str(table))
    assert profile.positions.tolist() == [0, 1, 2]
    assert profile.luminosities.tolist() == [1, 2, 4]


@pytest.mark.parametrize('depth', [np.uint8, np.uint16])
def test_a_picture_of_a_wedge_is_a_straight_profile(tmp_path, depth):
    top = np.iinfo(depth).max
    wedge = np.linspace(0.1, 0.9, 640) * top
    picture = tmp_path / 'wedge.png'
    Image.fromarray(np.tile(np.round(wedge), (8, 1)).astype(depth)).save(picture)
    profile = read_profile(str(picture), (1.0, 3.0))

    assert profile.positions[[0, -1]].tolist() == [1.0, 3.0]
    line = profile.line_around(np.array([2.0]))
    assert line.slope == pytest.approx(0.4, rel=0.01)
    assert line.slope_error < 0.02
    assert profile.luminosity(np.array(2.0)) == pytest.approx(0.5, rel=0.01)


def test_a_function_comes_from_a_file_or_from_a_module(tmp_path):
    own = tmp_path / 'lamp.py'
    own.write_text('import numpy as np\n\ndef lamp(s):\n    return np.exp(s)\n')
    ours = read_profile(f'{own}:lamp', (0.0, 1.0))
    theirs = read_profile('numpy:exp', (0.0, 1.0))
    assert np.array_equal(ours.luminosities, theirs.luminosities)
    assert ours.luminosities[-1] == pytest.approx(np.e)


@pytest.mark.parametrize(
    ('name', 'text', 'between', 'message'),
    [
        ('none.csv', None, (), 'cannot be read: No such file'),
        ('a.csv', '0,1\n1,2,3\n', (), 'a position and a luminosity in line 2'),
        ('a.csv', '0,1\nx,2\n', (), 'a position and a luminosity in line 2'),
        ('a.csv', 'x,y\na,b\n', (), 'a position and a luminosity in line 2'),
        ('a.csv', '', (), 'at least two positions'),
        ('a.csv', '0,1\n1,2\n', (0.0, 1.0), 'profile_range .* is not for a table'),
        ('a.png', 'no picture', (0.0, 1.0), 'can not be read as a picture'),
        ('a.png', 'no picture', (), 'profile_range = .*must be two increasing numbers'),
        ('a.png', 'no picture', (1.0, 0.0), 'must be two increasing numbers'),
        ('a.pdf', '', (), 'must be a table'),
        ('a.py:f', 'def g(s): return s\n', (0.0, 1.0), 'has no function f'),
        ('a.py:f', 'def f(s): return s / 0\n', (1.0, 2.0), 'must not contain|not finite|must be'),
        ('a.py:f', 'def f(s): raise KeyError(1)\n', (1.0, 2.0), 'fails: KeyError'),
        ('a.py:f', 'def f(s): return 1.0\n', (1.0, 2.0), 'a luminosity for each position'),
        ('a.py:f', 'import nowhere_at_all\n', (1.0, 2.0), 'can not be loaded: ModuleNotFound'),
        ('a.py:f', None, (1.0, 2.0), 'can not be loaded: FileNotFound'),
    ],
)
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_what_is_no_profile_is_refused_in_a_line(tmp_path, name, text, between, message):
    path = tmp_path / name.partition(':')[0]
    if text is not None:
        path.write_text(text)
    source = str(tmp_path / name)
    with pytest.raises(ParameterError, match=message) as raised:
        read_profile(source, between)
    assert '\n' not in str(raised.value)


def test_range_and_reach_need_a_profile():
    for changes in ({'profile_range': (0.0, 1.0)}, {'profile_reach': 0.1}):
        with pytest.raises(ParameterError, match='needs brightness_profile'):
            _ = Scenario.from_values(changes).scene


def test_a_path_with_a_dot_is_relative_to_the_parameter_file(tmp_path):
    (tmp_path / 'wall.csv').write_text('-9, 1\n9, 19\n')
    file = tmp_path / 'plant.yaml'
    file.write_text('/**:\n  ros__parameters:\n    brightness_profile: ./wall.csv\n')
    scenario = load_scenario(file)
    straight = Scenario()

    def seen(one):
        return one.scene.luminosity(one.model, one.initial_state)

    assert seen(scenario) == pytest.approx(seen(straight) + 10)
    assert scenario.linearisation.slope == pytest.approx(1)


def test_a_loaded_scenario_carries_its_profile_with_every_digit(tmp_path):
    rng = np.random.default_rng(1)
    rows = np.column_stack([np.cumsum(rng.uniform(0.1, 1, 9)) - 1, rng.uniform(1, 2, 9)])
    np.savetxt(tmp_path / 'wall.csv', rows, fmt='%.17g')
    file = tmp_path / 'plant.yaml'
    file.write_text('/**:\n  ros__parameters:\n    brightness_profile: ./wall.csv\n')
    scenario = load_scenario(file)
    (tmp_path / 'wall.csv').unlink()

    again = Scenario.from_values(dict(scenario.values)).scene.profile
    np.testing.assert_array_equal(again.positions, rows[:, 0])
    np.testing.assert_array_equal(again.luminosities, rows[:, 1])


@pytest.mark.parametrize('text', ['knots ', 'knots 1', 'knots 1 2; 0 3', 'knots 1 2; x y'])
def test_knots_that_do_not_fit_are_refused(text):
    with pytest.raises(ParameterError, match='brightness_profile'):
        read_profile(text)


def test_without_a_profile_luminosity_is_the_straight_line_itself():
    scenario = Scenario()
    scene, model = scenario.scene, scenario.model
    assert scene.profile is None
    np.testing.assert_array_equal(
        scene.luminosity(model, scenario.initial_state),
        float(model.output_vector @ scenario.initial_state) + scene.brightness_offsets,
    )
