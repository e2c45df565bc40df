"""Test scenes: range, motion, files."""

import itertools

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.tools.footage import open_footage, recorded_frames
from dvs_event_camera.tools.scenes import SCENES, Scene, synthetic_frames

SCENE = Scene(height=24, width=32, speed=100.0, frequency=5.0, period=16.0)


@pytest.mark.parametrize('name', SCENES)
def test_scene_stays_in_range_and_makes_events_of_both_polarities(name):
    frames = list(itertools.islice(synthetic_frames(name, SCENE, 5_000_000), 80))
    assert all(frame.shape == (24, 32) for frame in frames)
    assert min(frame.min() for frame in frames) >= 20.0
    assert max(frame.max() for frame in frames) <= 200.0
    array = PixelArray(event_threshold=0.2)
    polarity = np.concatenate(
        [array.update(k * 5_000_000, frame).polarity for k, frame in enumerate(frames)]
    )
    assert {-1, 1} == set(polarity.tolist())
    assert 0.2 < np.mean(polarity > 0) < 0.8


def test_grating_drifts_by_its_speed():
    assert np.allclose(SCENE.grating(0.02)[:, 2:], SCENE.grating(0.0)[:, :-2])


def test_disc_turns_by_its_frequency():
    assert np.allclose(
        SCENE.disc(0.0), SCENE.disc(0.05), atol=1e-9
    )  # a quarter turn, four sectors


def test_flicker_is_a_sinusoid_of_the_logarithm():
    level = np.log([SCENE.flicker(t)[0, 0] for t in (0.0, 0.05, 0.1)])
    assert level[1] == pytest.approx((level[0] + level[2]) / 2)


def test_folder_of_pictures(tmp_path):
    image = pytest.importorskip('PIL.Image')
    for number in range(3):
        pixels = np.full((4, 5), 10 * number, np.uint8)
        image.fromarray(pixels).save(tmp_path / f'frame_{number}.png')
    frames = list(recorded_frames(tmp_path))
    assert [frame[0, 0] for frame in frames] == [0, 10, 20]
    assert frames[0].shape == (4, 5)


def test_what_holds_no_pictures_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='no pictures'):
        recorded_frames(tmp_path)
    with pytest.raises(ParameterError, match='a folder of pictures'):
        recorded_frames(tmp_path / 'nothing')


def picture_file(path, pixels):
    image = pytest.importorskip('PIL.Image')
    image.fromarray(pixels).save(path)


def test_numbered_pictures_come_in_the_order_of_their_numbers(tmp_path):
    for number in (1, 2, 9, 10, 11, 100):
        picture_file(tmp_path / f'f{number}.png', np.full((2, 3), number, np.uint8))
    found = [int(frame[0, 0]) for frame in recorded_frames(tmp_path)]
    assert found == [1, 2, 9, 10, 11, 100]


def test_black_of_a_colour_picture_is_less_than_half_a_grey_level(tmp_path):
    picture_file(tmp_path / 'a.png', np.zeros((2, 3, 3), np.uint8))
    assert np.all(next(recorded_frames(tmp_path)) == 0.5)


def test_folder_brings_its_own_stamps(tmp_path):
    for number in range(3):
        picture_file(tmp_path / f'{number}.png', np.full((2, 3), number, np.uint8))
    (tmp_path / 'timestamps.txt').write_text('0.5\n0.54\n0.6\n')
    stamps = [stamp for stamp, _ in open_footage(tmp_path).stamped()]
    assert stamps == [0, 40_000_000, 100_000_000]
    (tmp_path / 'images.csv').write_text('# stamp, name\n100, 2.png\n350, 0.png\n')
    stamped = [(stamp, int(frame[0, 0])) for stamp, frame in open_footage(tmp_path).stamped()]
    assert stamped == [(0, 2), (250, 0)]


@pytest.mark.parametrize('text', ['0.1\n0.2\n', '0.1\n0.2\n0.2\n', '0.1\nsoon\n0.3\n'])
def test_stamps_that_do_not_fit_their_pictures_are_refused(tmp_path, text):
    for number in range(3):
        picture_file(tmp_path / f'{number}.png', np.full((2, 3), number, np.uint8))
    (tmp_path / 'timestamps.txt').write_text(text)
    with pytest.raises(ParameterError, match='source'):
        open_footage(tmp_path)


def test_video_has_the_rate_of_its_file(tmp_path):
    cv2 = pytest.importorskip('cv2')
    path = tmp_path / 'v.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 25.0, (32, 24), False)
    for k in range(5):
        writer.write(np.full((24, 32), 40 + 20 * k, np.uint8))
    writer.release()
    stamped = list(open_footage(path).stamped())
    assert [stamp for stamp, _ in stamped] == [0, 40_000_000, 80_000_000, 120_000_000, 160_000_000]
    assert np.allclose([frame.mean() for _, frame in stamped], 40 + 20 * np.arange(5), atol=3)


@pytest.mark.parametrize(
    'changes', [{'dark': 0.0}, {'dark': 300.0}, {'height': 0}, {'period': 0.0}, {'speed': np.nan}]
)
def test_measures_are_checked(changes):
    with pytest.raises(ParameterError):
        Scene(**changes)
