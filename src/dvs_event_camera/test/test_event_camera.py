"""Frames in, packets out: restarts, frames sent again, long gaps, running index, labels."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import (
    EVENT_DTYPE,
    LABELLED_EVENT_DTYPE,
    EventPacket,
    make_events,
    pack_events,
    parse_events,
)
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents
from dvs_event_camera.streams.event_records import records_of, without_labels
from dvs_event_camera.streams.image_source import LuminosityFrame

MS = 1_000_000
SECOND = 1_000_000_000


def camera_with(**values):
    return EventCamera.of_scenario(
        Scenario.from_values({'event_threshold': 0.1, 'reference_uncertainty': 0.0, **values})
    )


def frame(stamp_ns, pixels, darkest=0.0):
    return LuminosityFrame(
        stamp_ns=stamp_ns, pixels=np.atleast_2d(np.asarray(pixels)), darkest=darkest
    )


def test_one_packet_a_frame_with_the_frames_stamp_and_a_running_index():
    camera = camera_with()
    first = camera.take(frame(5, [1.0, 1.0, 1.0]))
    assert first.started
    assert [packet.stamp_ns for packet in first.packets] == [5]
    assert len(first.packets[0].events) == 0
    quiet = camera.take(frame(6 * MS, [1.0, 1.0, 1.0]))
    assert [len(packet.events) for packet in quiet.packets] == [0]
    fired = camera.take(frame(7 * MS, [1.0, math.exp(0.25), math.exp(-0.15)]))
    records = fired.packets[0].events
    assert records['x'].tolist() == [1, 2, 1]
    assert records['y'].tolist() == [0, 0, 0]
    assert records['polarity'].tolist() == [1, -1, 1]
    assert records['index'].tolist() == [0, 1, 2]
    assert np.all((records['t'] > -MS) & (records['t'] <= 0))
    again = camera.take(frame(8 * MS, [1.0, 1.0, 1.0]))
    assert again.packets[0].events['index'].tolist() == [3, 4, 5]


def test_row_and_column_are_those_of_the_image():
    camera = camera_with()
    y = np.ones((3, 4))
    camera.take(frame(0, y))
    y[2, 1] = 1.2
    records = camera.take(frame(MS, y)).packets[0].events
    assert (records['x'][0], records['y'][0]) == (1, 2)


def test_frame_sent_again_is_ignored():
    camera = camera_with()
    camera.take(frame(0, [1.0]))
    assert camera.take(frame(0, [5.0])) is None
    camera.take(frame(MS, [1.0]))
    assert camera.take(frame(MS, [5.0])) is None
    assert camera.pixels.counts.tolist() == [0]


@pytest.mark.parametrize(
    ('second', 'reason'),
    [(frame(0, [1.0, 2.0]), 'go back'), (frame(2 * MS, [[1.0], [2.0]]), '1 x 2 to 2 x 1')],
)
def test_source_that_starts_again_restarts_the_sensor(second, reason):
    camera = camera_with()
    camera.take(frame(MS, [1.0, 1.0]))
    exposure = camera.take(second)
    assert exposure.started
    assert reason in exposure.restart_reason
    assert len(exposure.events) == 0
    assert camera.pixels.counts.tolist() == [0, 0]
    assert camera.take(frame(3 * MS, second.pixels)).restart_reason == ''


def test_interval_longer_than_int32_nanoseconds_is_split_and_nothing_overflows():
    camera = camera_with()
    camera.take(frame(0, [1.0, 1.0]))
    stamp = 10 * SECOND
    exposure = camera.take(frame(stamp, [math.exp(1.05), 1.0]))
    times = np.concatenate(
        [packet.stamp_ns + packet.events['t'].astype(np.int64) for packet in exposure.packets]
    )
    assert np.array_equal(times, exposure.events.t)
    assert np.allclose(times, stamp * np.arange(1, 11) / 10.5, atol=2)
    stamps = [packet.stamp_ns for packet in exposure.packets]
    assert stamps == sorted(stamps)
    assert stamps[-1] == stamp
    assert len(stamps) == 5
    assert all(np.all(packet.events['t'] <= 0) for packet in exposure.packets)
    index = np.concatenate([packet.events['index'] for packet in exposure.packets])
    assert index.tolist() == list(range(10))


def test_day_of_silence_costs_one_packet():
    camera = camera_with()
    camera.take(frame(0, [1.0]))
    exposure = camera.take(frame(86_400 * SECOND, [1.05]))
    assert len(exposure.packets) == 1


def test_violated_a1_is_an_error_that_names_the_pixel():
    with pytest.raises(ParameterError, match='pixel 1'):
        camera_with(reference_uncertainty=0.5).take(frame(0, [100.0, 1.0]))


def test_integer_images_may_be_black():
    camera = camera_with(event_threshold=0.5)
    camera.take(frame(0, np.zeros((1, 2), np.uint8), darkest=0.5))
    events = camera.take(frame(MS, np.array([[0, 1]], np.uint8), darkest=0.5)).events
    assert events.pixel.tolist() == [1]  # from "less than 0.5" to 1: ln 2
    assert camera.invalid_samples == 0


def test_invalid_samples_are_counted_across_restarts():
    camera = camera_with()
    for stamp, y in ((0, 1.0), (MS, -1.0), (0, 1.0), (MS, np.nan), (2 * MS, 1.0)):
        camera.take(frame(stamp, [y]))
    assert camera.invalid_samples == 2


def test_labels_travel_in_the_padding():
    camera = camera_with(label_noise=True, hot_pixel_fraction=0.5, hot_pixel_rate=100.0)
    camera.take(frame(0, np.ones(4)))
    exposure = camera.take(frame(SECOND, [1.0, 1.0, 1.0, 1.0]))
    packet = exposure.packets[0]
    assert packet.events.dtype == LABELLED_EVENT_DTYPE
    assert len(packet.events) == pytest.approx(200, abs=2)
    assert np.all(packet.events['noise'] == 1)
    parsed = parse_events(pack_events(packet))
    assert np.array_equal(parsed.events, packet.events)
    plain = without_labels(packet).events
    assert plain.dtype == EVENT_DTYPE
    sent = pack_events(EventPacket(stamp_ns=packet.stamp_ns, events=plain))
    assert parse_events(sent).events.dtype == EVENT_DTYPE
    assert not np.any(plain.view(np.uint8).reshape(-1, 16)[:, 14:])


@pytest.mark.parametrize('name', ['lin_log', 'hermite', 'imperfect'])
def test_scenario_reaches_the_pixels(name):
    changes = {
        'lin_log': {'photoreceptor': 'lin_log'},
        'hermite': {'interpolation': 'hermite'},
        'imperfect': {'refractory_period': 0.01},
    }[name]
    rng = np.random.default_rng(0)
    frames = [frame(k * MS, rng.integers(1, 60, (1, 50)).astype(float)) for k in range(5)]
    changed, plain = camera_with(**changes), camera_with()
    times = [
        np.concatenate([camera.take(f).events.t for f in frames]) for camera in (changed, plain)
    ]
    assert not np.array_equal(*times)


def test_parameters_that_do_not_fit_together_are_refused_before_the_first_frame():
    with pytest.raises(ParameterError, match='signed_log'):
        camera_with(photoreceptor='signed_log', jitter=1e-3)


def test_compiled_records_are_the_records():
    pytest.importorskip('numba')
    rng = np.random.default_rng(0)
    size = 5000
    events = PixelEvents(
        t=np.sort(rng.integers(10**15, 10**15 + 10**9, size)),
        pixel=rng.integers(0, 2**20, size).astype(np.int32),
        polarity=rng.choice(np.array([-1, 1], np.int8), size),
        sign=rng.choice(np.array([-1, 1], np.int8), size),
    )
    fields = {'width': 1280, 'stamp_ns': 10**15 + 10**9, 'first_index': 2**32 - 100}
    expected = make_events(
        times_ns=events.t,
        pixels=events.pixel,
        polarities=events.polarity,
        signs=events.sign,
        **fields,
    )
    assert np.array_equal(records_of(events, backend='numba', **fields), expected)
    assert np.array_equal(records_of(events, backend='numpy', **fields), expected)


def test_memory_of_the_pixels_does_not_grow():
    array = PixelArray(event_threshold=0.1, backend='numpy')
    array.update(0, np.ones(1000))
    owned = [v.nbytes for v in vars(array.engine.comparator).values() if isinstance(v, np.ndarray)]
    assert sum(owned) <= 3 * 8 * 1000


def test_packet_is_the_point_cloud_that_others_read():
    messages = pytest.importorskip('sensor_msgs.msg')
    serialization = pytest.importorskip('rclpy.serialization')
    camera = camera_with(label_noise=True)
    camera.take(frame(0, [1.0, 1.0]))
    for stamp, y in ((MS, [1.0, 1.0]), (1_700_000_000 * SECOND + 7, [1.0, 3.0])):
        packet = camera.take(frame(stamp, y)).packets[-1]
        cloud = serialization.deserialize_message(pack_events(packet), messages.PointCloud2)
        assert cloud.header.stamp.sec * SECOND + cloud.header.stamp.nanosec == stamp
        assert (cloud.height, cloud.width) == (1, len(packet.events))
        assert (cloud.point_step, cloud.row_step) == (16, 16 * len(packet.events))
        assert cloud.is_dense
        assert bytes(cloud.data) == packet.events.tobytes()
        offsets = {field.name: field.offset for field in cloud.fields}
        assert offsets == {n: f[1] for n, f in packet.events.dtype.fields.items()}
        assert parse_events(pack_events(packet)).stamp_ns == stamp


@pytest.mark.parametrize('noise', ['leak_rate', 'shot_noise_rate'])
def test_a_clock_that_jumps_by_a_year_does_not_fill_the_memory_with_noise(noise):
    year_ns = 365 * 86_400 * 1000 * MS
    camera = camera_with(**{noise: 1.0})
    camera.take(frame(0, [1.0, 1.0]))
    camera.take(frame(MS, [1.0, 1.0]))

    exposure = camera.take(frame(MS + year_ns, [1.0, 1.0]))

    assert exposure.started
    assert 'the stamps jump by 3.1536e+07 s' in exposure.restart_reason
    assert len(exposure.events) == 0


@given(
    st.lists(st.floats(0.8, 1.25), min_size=2, max_size=30),
    st.sampled_from([-1, 0, 1]),
)
@settings(max_examples=60, deadline=None)
def test_a_frame_that_passes_in_silence_leaves_what_taking_it_leaves(changes, wrong_at):
    plain, quick = (camera_with() for _ in range(2))
    pixels, stamp_ns = np.full((1, 3), 5.0), 0
    for k, change in enumerate(changes):
        pixels = pixels * change
        stamp_ns += MS if k % 7 else wrong_at * MS
        taken = frame(stamp_ns, pixels)
        expected = plain.take(taken)
        if quick.pass_silence(stamp_ns, tuple(pixels.ravel().tolist()), pixels.shape):
            assert expected is not None and len(expected.packets) == 1
            assert expected.packets[0].stamp_ns == stamp_ns
            assert not len(expected.packets[0].events)
            assert not (expected.started or expected.restart_reason)
        else:
            found = quick.take(taken)
            assert (found is None) == (expected is None)
            if found is not None and expected is not None:
                assert [pack_events(packet) for packet in found.packets] == [
                    pack_events(packet) for packet in expected.packets
                ]
        assert quick.pixels.stamp_ns == plain.pixels.stamp_ns
        assert np.array_equal(quick.keyframe().counts, plain.keyframe().counts)


def test_no_frame_passes_in_silence_that_starts_the_sensor_or_has_another_size():
    camera = camera_with()
    assert not camera.pass_silence(0, (5.0,) * 3, (1, 3))
    camera.take(frame(0, np.full((1, 3), 5.0)))
    assert camera.pass_silence(MS, (5.0,) * 3, (1, 3))
    assert not camera.pass_silence(MS, (5.0,) * 3, (1, 3))
    assert not camera.pass_silence(2 * MS, (5.0,) * 3, (3, 1))
    camera.restart('asked')
    assert not camera.pass_silence(2 * MS, (5.0,) * 3, (1, 3))
