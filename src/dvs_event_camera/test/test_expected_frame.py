"""Frames in which nothing happens, answered by their bytes: the answers of the general path."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.scenario.scenario import Scenario
from dvs_common.wire.events import pack_events
from dvs_common.wire.messages import pack_image
from dvs_common.wire.stamp_gate import StampGate
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.expected_frame import ExpectedFrames
from dvs_event_camera.streams.image_source import parse_luminosity

MS = 1_000_000


class Stream:
    """A camera that takes the fast path where there is one, and counts how often."""

    def __init__(self):
        values = {'event_threshold': 0.1, 'reference_uncertainty': 0.0}
        self.camera = EventCamera.of_scenario(Scenario.from_values(values))
        self.gate = StampGate()
        self.frames = ExpectedFrames(self.gate)
        self.short = 0

    def answers(self, message, before_ns=math.inf):
        silent = self.frames.take(message, self.camera)
        if silent is None:
            answers = self.general_path(message)
        else:
            answers = [silent.answer]
            self.short += 1
        self.frames.expect_after(message, before_ns=before_ns)
        return answers

    def general_path(self, message):
        frame = parse_luminosity(message)
        self.gate.take(frame.stamp_ns)
        exposure = self.camera.take(frame)
        return [] if exposure is None else [pack_events(packet) for packet in exposure.packets]


def image(stamp_ns, value, shape=(1, 3), dtype='<f8', encoding='64FC1'):
    return pack_image(stamp_ns, np.full(shape, value).astype(dtype), encoding)


@given(
    st.lists(
        st.tuples(st.sampled_from([1, 1, 1, 1, 0, 2, -1]), st.floats(0.9, 1.1)),
        min_size=3,
        max_size=40,
    )
)
@settings(max_examples=100, deadline=None)
def test_the_packets_are_those_of_the_general_path(steps):
    short, long = Stream(), Stream()
    stamp_ns, value = 0, 5.0
    for steps_ms, factor in steps:
        stamp_ns += steps_ms * MS
        value *= factor
        message = image(stamp_ns, value)
        assert short.answers(message) == long.general_path(message)
        assert short.gate.last_ns == long.gate.last_ns
        assert short.camera.pixels.stamp_ns == long.camera.pixels.stamp_ns
        assert np.array_equal(short.camera.pixels.counts, long.camera.pixels.counts)


def test_a_regular_stream_at_rest_takes_the_fast_path_from_its_third_frame_on():
    stream = Stream()
    for k in range(10):
        assert len(stream.answers(image(k * MS, 5.0))) == 1

    assert stream.short == 8


@pytest.mark.parametrize(
    'message',
    [
        image(11 * MS, 5.0),
        image(10 * MS, 5.0)[:-1],
        image(10 * MS, 5.0) + b'\0',
        image(10 * MS, 5.0, shape=(3, 1)),
        image(10 * MS, 5.0, dtype='<f4', encoding='32FC1'),
        image(10 * MS, 50.0),
        image(10 * MS, math.nan),
        b'',
    ],
    ids=['late', 'cut', 'longer', 'turned', 'floats', 'events', 'nan', 'empty'],
)
def test_any_other_frame_is_left_to_the_general_path(message):
    stream = Stream()
    for k in range(10):
        stream.answers(image(k * MS, 5.0))

    assert stream.frames.take(message, stream.camera) is None
    assert stream.gate.last_ns == stream.camera.pixels.stamp_ns == 9 * MS


def test_nothing_is_expected_once_more_is_due_or_it_is_forgotten():
    stream = Stream()
    for k in range(10):
        stream.answers(image(k * MS, 5.0), before_ns=10 * MS)
    assert stream.frames.take(image(10 * MS, 5.0), stream.camera) is None

    stream.answers(image(10 * MS, 5.0))
    stream.frames.forget()
    assert stream.frames.take(image(11 * MS, 5.0), stream.camera) is None
