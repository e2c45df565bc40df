"""Keyframes of others are taken at their word only if the word makes sense."""

import numpy as np
import pytest

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.keyframe import parse_keyframe
from dvs_common.wire.messages import pack_image


def message(pixels, encoding):
    return pack_image(0, np.array([pixels]), encoding)


def test_sound_values_are_read():
    keyframe = parse_keyframe(message(np.array([[3.0, -1.0, 0.5]]), '64FC3'))

    assert keyframe.counts.tolist() == [3]
    assert keyframe.signs.tolist() == [-1]
    assert keyframe.moved.tolist() == [0.5]


@pytest.mark.parametrize(
    ('pixel', 'encoding'),
    [
        (np.array([[3, 7]], np.int32), '32SC2'),
        (np.array([[3, 0]], np.int32), '32SC2'),
        (np.array([[3.0, 5.0, 0.0]]), '64FC3'),
        (np.array([[0.5, 1.0, 0.0]]), '64FC3'),
        (np.array([[np.nan, 1.0, 0.0]]), '64FC3'),
        (np.array([[3.0, 1.0, np.inf]]), '64FC3'),
    ],
)
def test_values_that_no_sensor_has_are_refused(pixel, encoding):
    with pytest.raises(MessageError, match='whole counts, signs'):
        parse_keyframe(message(pixel, encoding))
