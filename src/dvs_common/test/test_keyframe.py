"""Keyframes and anchors of others are taken at their word only if the word makes sense."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.anchor import Anchor, pack_anchor, parse_anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import NO_EVENTS, EventPacket, pack_events
from dvs_common.wire.keyframe import KEYFRAME_DTYPE, Keyframe, pack_keyframe, parse_keyframe
from dvs_common.wire.messages import pack_image
from dvs_common.wire.points import Points, pack_points, parse_points

PIXELS = 6


def keyframe(**others):
    values = {
        'stamp_ns': 3_000_000_007,
        'epoch': 2**32 - 1,
        'age_s': 1.5,
        'events': 2**40,
        'next_index': 17,
        'event_threshold': 0.15,
        'counts': np.arange(PIXELS) - 2,
        'signs': np.where(np.arange(PIXELS) % 2, 1, -1).astype(np.int8),
        'lower': np.linspace(0.1, 0.6, PIXELS),
        'upper': np.linspace(0.2, 0.7, PIXELS),
        **others,
    }
    return Keyframe(**values)


def assert_equal(found, expected):
    for name in Keyframe.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def test_a_keyframe_comes_back_as_it_was():
    assert_equal(parse_keyframe(pack_keyframe(keyframe(), height=2, width=3)), keyframe())


def test_unknown_references_travel_without_an_infinity():
    sent = keyframe(lower=np.zeros(PIXELS), upper=np.full(PIXELS, np.inf))
    message = pack_keyframe(sent, height=2, width=3)

    assert np.isfinite(parse_points(message, KEYFRAME_DTYPE).records['upper']).all()
    assert_equal(parse_keyframe(message), sent)


BAD = {
    'version': (1, 'contract version 1'),
    'sign': (0, 'signs'),
    'epoch': (1, 'must be the same'),
    'threshold': (0.2, 'must be the same'),
    'lower': (-1.0, 'bounds'),
    'upper': (np.nan, 'bounds'),
}


@pytest.mark.parametrize('name', BAD)
def test_numbers_that_no_sensor_has_are_refused(name):
    value, reason = BAD[name]
    points = parse_points(pack_keyframe(keyframe(), height=2, width=3), KEYFRAME_DTYPE)
    records = points.records.copy()
    records[name][1, 1] = value
    if name == 'version':
        records[name] = value

    with pytest.raises(MessageError, match=reason):
        parse_keyframe(pack_points(Points(stamp_ns=0, records=records)))


@pytest.mark.parametrize(
    'numbers',
    [
        {'event_threshold': 0.0},
        {'event_threshold': np.nan},
        {'event_threshold': 1e3},
        {'age_s': -1.0},
        {'age_s': np.inf},
        {'events': 0.5},
    ],
)
def test_what_holds_for_all_pixels_must_be_in_its_range(numbers):
    with pytest.raises(MessageError, match=r'out of its range|must be the same'):
        parse_keyframe(pack_keyframe(keyframe(**numbers), height=2, width=3))


def test_other_messages_are_no_keyframes():
    events = pack_events(EventPacket(stamp_ns=0, events=NO_EVENTS))
    with pytest.raises(MessageError, match="are not the contract's"):
        parse_keyframe(events)
    # A keyframe of the first version was an image.
    with pytest.raises(MessageError):
        parse_keyframe(pack_image(0, np.zeros((2, 3), np.int32), '32SC1'))


@given(st.data())
def test_a_keyframe_cut_short_or_with_a_bit_flipped_is_read_or_refused(data):
    message = bytearray(pack_keyframe(keyframe(), height=2, width=3))
    at = data.draw(st.integers(4, len(message) - 1))
    message[at] ^= 1 << data.draw(st.integers(0, 7))
    end = data.draw(st.integers(4, len(message)))
    for broken in (bytes(message), bytes(message[:end])):
        try:
            found = parse_keyframe(broken)
        except MessageError:
            continue
        assert found.counts.size <= PIXELS
        assert np.isfinite(found.lower).all()


@pytest.mark.parametrize(
    ('encoding', 'kind'),
    [('64FC1', '<f8'), ('32FC1', '<f4'), ('mono8', 'u1'), ('mono16', '<u2')],
)
def test_an_anchor_is_an_image_of_one_channel(encoding, kind):
    pixels = np.array([[1, 2, 3], [0, 5, 6]]).astype(kind)
    found = parse_anchor(pack_image(5, pixels, encoding))

    assert found.stamp_ns == 5
    assert found.luminosity.tolist() == [1, 2, 3, 0, 5, 6]


def test_values_that_are_no_luminosity_count_as_not_measured():
    y = np.array([1.0, np.nan, -3.0, np.inf, 0.0, 2.0])
    found = parse_anchor(pack_anchor(Anchor(stamp_ns=0, luminosity=y), height=2, width=3))
    assert found.luminosity.tolist() == [1, 0, 0, 0, 0, 2]


def test_an_anchor_in_colours_is_refused():
    with pytest.raises(MessageError, match='anchor must be'):
        parse_anchor(pack_image(0, np.zeros((2, 3, 3), np.uint8), 'bgr8'))
