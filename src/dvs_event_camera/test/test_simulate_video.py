"""A video in, events out: files, times, presets and what is refused."""

import numpy as np
import pytest

from dvs_common.errors import ParameterError
from dvs_common.scenario.presets import PRESETS, preset_named
from dvs_event_camera.cli import main
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.tools.frame_interpolation import interpolated

cv2 = pytest.importorskip('cv2')
pytest.importorskip('tqdm')


def blob(x, size=(24, 40)):
    """Smooth bright spot at column x."""
    rows, columns = np.indices(size)
    return 40 + 180 * np.exp(-((rows - 12) ** 2 + (columns - x) ** 2) / 30.0)


def folder_of(path, frames):
    path.mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(str(path / f'{k}.png'), np.rint(frame).astype(np.uint8))
    return path


def test_events_of_a_folder_are_those_of_its_pixels(tmp_path, capsys):
    frames = [blob(8 + 0.7 * k) for k in range(12)]
    source = folder_of(tmp_path / 'in', frames)
    out = tmp_path / 'events.npz'
    assert main(['simulate_video', str(source), '--output', str(out), '--rate', '100']) == 0
    array = PixelArray(event_threshold=0.15)
    parts = [
        array.update(k * 10_000_000, np.rint(f).astype(np.uint8)) for k, f in enumerate(frames)
    ]
    found = np.load(out)
    pixel = np.concatenate([part.pixel for part in parts])
    assert np.array_equal(found['t'], np.concatenate([part.t for part in parts]))
    assert np.array_equal(found['x'], pixel % 40)
    assert np.array_equal(found['y'], pixel // 40)
    assert np.array_equal(found['p'], np.concatenate([p.polarity for p in parts]) > 0)
    assert f'12 frames in 0.11 s: {pixel.size} events' in capsys.readouterr().out


def test_video_comes_at_its_own_rate_with_preview_and_figure(tmp_path, capsys):
    source, video = tmp_path / 'v.avi', None
    video = cv2.VideoWriter(str(source), cv2.VideoWriter_fourcc(*'MJPG'), 25.0, (40, 24), False)
    for k in range(10):
        video.write(np.rint(blob(5 + 3 * k)).astype(np.uint8))
    video.release()
    names = {name: tmp_path / name for name in ('e.h5', 'p.mp4', 'f.png')}
    arguments = ['--output', 'e.h5', '--preview', 'p.mp4', '--figure', 'f.png']
    arguments = [str(names.get(word, word)) for word in arguments]
    assert main(['simulate_video', str(source), '--preset', 'noisy', *arguments]) == 0
    assert '10 frames in 0.36 s' in capsys.readouterr().out
    h5py = pytest.importorskip('h5py')
    with h5py.File(names['e.h5']) as file:
        t = file['events/t'][:]
        assert t.size > 100
        assert np.all(np.diff(t) >= 0)
        assert 0 <= t[0] <= t[-1] <= 360_000
    preview = cv2.VideoCapture(str(names['p.mp4']))
    assert preview.get(cv2.CAP_PROP_FRAME_COUNT) == 10
    assert preview.get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)
    assert cv2.imread(str(names['f.png'])).std() > 1


def test_labels_are_kept_where_they_are_asked_for(tmp_path):
    source = folder_of(tmp_path / 'in', [blob(8)] * 6)
    parameters = tmp_path / 'p.yaml'
    parameters.write_text('/**:\n  ros__parameters:\n    label_noise: true\n    leak_rate: 20.0\n')
    out = tmp_path / 'e.npz'
    arguments = ['--output', str(out), '--rate', '10', '--params-file', str(parameters)]
    assert main(['simulate_video', str(source), *arguments]) == 0
    found = np.load(out)
    assert found['t'].size == pytest.approx(20 * 0.5 * 24 * 40, rel=0.1)
    assert np.all(found['noise'] == 1)


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        (['--output', 'e.npz'], 'no times'),
        (['--output', 'e.npz', '--rate', '0'], 'rate'),
        (['--output', 'e.npz', '--rate', '10', '--preset', 'perfect'], 'noisy'),
        (['--output', 'e.npz', '--rate', '10', '--interpolate', '0'], 'interpolate'),
        (['--output', 'e.zip', '--rate', '10'], 'output'),
        (['--output', 'e.npz', '--rate', '10', '--threshold', '-1'], 'event_threshold'),
    ],
)
def test_what_makes_no_sense_is_one_line_and_no_file(
    tmp_path, capsys, monkeypatch, arguments, word
):
    monkeypatch.chdir(tmp_path)
    folder_of(tmp_path / 'in', [blob(8), blob(9)])
    assert main(['simulate_video', 'in', *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert word in error
    assert '\n' not in error
    assert [path.name for path in tmp_path.iterdir()] == ['in']


def test_what_comes_before_a_broken_picture_is_kept(tmp_path, capsys):
    source, out = folder_of(tmp_path / 'in', [blob(8 + k) for k in range(6)]), tmp_path / 'e.npz'
    (source / '4.png').write_bytes(b'\x89PNG of nothing')
    arguments = ['simulate_video', str(source), '--output', str(out), '--rate', '100']
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert '4 frames in 0.03 s' in printed.out
    assert '4.png: can not be decoded' in printed.err
    assert printed.err.count('\n') == 1
    assert np.load(out)['t'].max() <= 30_000_000
    (source / '0.png').write_bytes(b'')
    assert main(arguments) == 2
    assert 'has no frames that can be decoded' in capsys.readouterr().err


def test_a_video_that_is_cut_off_is_read_up_to_there(tmp_path, capfd):
    whole = tmp_path / 'whole.avi'
    video = cv2.VideoWriter(str(whole), cv2.VideoWriter_fourcc(*'MJPG'), 25.0, (40, 24), False)
    for k in range(20):
        video.write(np.rint(blob(3 + 2 * k)).astype(np.uint8))
    video.release()
    octets = whole.read_bytes()
    (tmp_path / 'cut.avi').write_bytes(octets[: len(octets) * 3 // 4])
    out = tmp_path / 'e.npz'
    assert main(['simulate_video', str(tmp_path / 'cut.avi'), '--output', str(out)]) == 1
    assert 'of 20 frames; the rest was read' in capfd.readouterr().err
    assert np.load(out)['t'].size > 0


def test_flow_moves_a_spot_where_a_blend_would_show_it_twice():
    ends = [(0, blob(12.0)), (1000, blob(18.0))]
    stamps, pictures = zip(*interpolated(iter(ends), 3), strict=True)
    assert stamps == (0, 333, 666, 1000)
    for share, picture in ((1 / 3, pictures[1]), (2 / 3, pictures[2])):
        truth = blob(12.0 + 6.0 * share)
        blend = (1 - share) * ends[0][1] + share * ends[1][1]
        assert np.abs(picture - truth).mean() < 0.5 * np.abs(blend - truth).mean()


@pytest.mark.parametrize('name', PRESETS)
def test_presets_are_parameters_of_the_camera_with_a_source(name):
    from dvs_common.scenario.scenario import Scenario

    preset = preset_named(name)
    assert len(preset.source) > 5
    scenario = Scenario.from_values({'preset': name, 'jitter': 0.5})
    EventCamera.of_scenario(scenario)
    expected = {**Scenario.from_values({}).values, **preset.values, 'preset': name, 'jitter': 0.5}
    assert dict(scenario.values) == expected
    # What is given counts more; so does all of a scenario that was written down whole.
    assert Scenario.from_values({'preset': name, 'event_threshold': 0.3})['event_threshold'] == 0.3
    assert Scenario.from_values(scenario.values).values == scenario.values


def test_preset_that_is_none_is_refused():
    with pytest.raises(ParameterError, match='clean'):
        preset_named('perfect')
