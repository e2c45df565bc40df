"""Our bytes are ROS messages: rclpy reads them, and we read rclpy's."""

import array
import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import (
    ImageFormat,
    Vector,
    luminosity_image,
    pack_array,
    pack_clock,
    pack_command,
    pack_image,
    pack_state,
    parse_array,
    parse_command,
    parse_image,
    parse_state,
)

texts = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=9)
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
names = st.lists(texts, max_size=5).map(tuple)
doubles = st.lists(st.floats(), max_size=6).map(lambda values: np.array(values, dtype=float))
vectors = st.builds(
    lambda stamp, pairs: Vector(
        stamp_ns=stamp,
        names=tuple(name for name, _ in pairs),
        values=np.array([value for _, value in pairs], dtype=float),
    ),
    stamps,
    st.lists(st.tuples(texts, st.floats()), max_size=5),
)


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def as_ros_serializes(message):
    """Bytes of rclpy, its padding made conspicuous: the standard leaves it undefined."""
    return bytes(serialize_message(message)) + b'\xa5' * 3


@given(vectors)
def test_rclpy_reads_our_state(vector):
    message = deserialize_message(pack_state(vector), JointState)

    assert nanoseconds(message.header.stamp) == vector.stamp_ns
    assert tuple(message.name) == vector.names
    np.testing.assert_array_equal(message.position, vector.values)
    assert len(message.velocity) == len(message.effort) == 0


@given(vectors)
def test_rclpy_reads_our_command(vector):
    message = deserialize_message(pack_command(vector), JointState)

    assert nanoseconds(message.header.stamp) == vector.stamp_ns
    assert tuple(message.name) == vector.names
    np.testing.assert_array_equal(message.effort, vector.values)
    assert len(message.velocity) == len(message.position) == 0


@pytest.mark.parametrize(
    ('part', 'pack', 'parse'),
    [('position', pack_state, parse_state), ('effort', pack_command, parse_command)],
)
@given(vector=vectors, frame=texts, velocity=doubles)
def test_we_read_rclpys_joint_states_and_our_own(part, pack, parse, vector, frame, velocity):
    message = JointState(name=list(vector.names), velocity=velocity.tolist())
    setattr(message, part, vector.values.tolist())
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(vector.stamp_ns, 10**9)

    for found in (parse(as_ros_serializes(message)), parse(pack(vector))):
        assert (found.stamp_ns, found.names) == (vector.stamp_ns, vector.names)
        np.testing.assert_array_equal(found.values, vector.values)


def test_a_joint_state_without_a_value_for_every_name_is_refused():
    message = bytes(serialize_message(JointState(name=['u1', 'u2'], effort=[1.0])))

    with pytest.raises(MessageError, match='2 names but 1 entries of effort'):
        parse_command(message)
    with pytest.raises(MessageError, match='2 names but 0 entries of position'):
        parse_state(message)


PIXEL_TYPES = {'64FC1': '<f8', '32SC1': '<i4', 'mono8': 'u1', 'bgr8': 'u1'}


@pytest.mark.parametrize('encoding', PIXEL_TYPES)
@given(height=st.integers(1, 4), width=st.integers(1, 5), stamp=stamps)
def test_rclpy_reads_our_image(encoding, height, width, stamp):
    shape = (height, width, 3) if encoding == 'bgr8' else (height, width)
    pixels = np.arange(np.prod(shape)).astype(PIXEL_TYPES[encoding]).reshape(shape)

    message = deserialize_message(pack_image(stamp, pixels, encoding), Image)

    assert nanoseconds(message.header.stamp) == stamp
    assert message.header.frame_id == 'pixels'
    assert (message.height, message.width, message.encoding) == (height, width, encoding)
    assert not message.is_bigendian
    assert message.step * height == len(message.data)
    assert bytes(message.data) == pixels.tobytes()


@given(st.binary(max_size=24), st.integers(0, 4), texts, texts, st.booleans(), stamps)
def test_we_read_rclpys_image(row, height, encoding, frame, big_endian, stamp):
    message = Image(height=height, width=3, encoding=encoding, step=len(row))
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.is_bigendian = int(big_endian)
    message.data = array.array('B', row * height)

    found = parse_image(as_ros_serializes(message))

    assert found.stamp_ns == stamp
    assert found.format == ImageFormat(
        height=height, width=3, encoding=encoding, big_endian=big_endian, step=len(row)
    )
    assert bytes(found.data) == row * height


def test_an_image_whose_rows_are_not_full_is_refused():
    message = Image(height=2, width=3, encoding='mono8', step=3, data=array.array('B', bytes(5)))

    with pytest.raises(MessageError, match='2 rows of 3 bytes do not fit 5 bytes'):
        parse_image(bytes(serialize_message(message)))


@given(st.integers(1, 4), st.integers(1, 5), st.data())
def test_luminosity_reads_back_to_the_bit(height, width, data):
    y = np.array(
        data.draw(st.lists(st.floats(), min_size=height * width, max_size=height * width))
    )

    frame = parse_image(pack_image(0, y.reshape(height, width), '64FC1'))

    assert luminosity_image(frame).tobytes() == y.tobytes()


@pytest.mark.parametrize(
    'change',
    [{'encoding': '32FC1'}, {'is_bigendian': 1}, {'width': 2}, {'width': 4}],
    ids=str,
)
def test_luminosity_in_another_layout_is_refused(change):
    fields = {'height': 1, 'width': 3, 'encoding': '64FC1', 'step': 24, **change}
    message = Image(**fields, data=array.array('B', bytes(24)))

    with pytest.raises(MessageError, match='little-endian 64FC1 with packed rows'):
        luminosity_image(parse_image(bytes(serialize_message(message))))


@given(doubles)
def test_rclpy_reads_our_array_and_we_do(values):
    message = deserialize_message(pack_array(values), Float64MultiArray)

    np.testing.assert_array_equal(message.data, values)
    assert not message.layout.dim
    assert message.layout.data_offset == 0
    assert parse_array(pack_array(values)).tobytes() == values.tobytes()


@given(doubles, st.lists(texts, max_size=3))
def test_we_read_rclpys_array_with_dimensions(values, labels):
    dim = [MultiArrayDimension(label=label, size=1, stride=2) for label in labels]
    message = Float64MultiArray(layout=MultiArrayLayout(dim=dim), data=values.tolist())

    np.testing.assert_array_equal(parse_array(as_ros_serializes(message)), values)


@given(stamps)
def test_rclpy_reads_our_clock(stamp):
    assert nanoseconds(deserialize_message(pack_clock(stamp), Clock).clock) == stamp


VECTOR = Vector(stamp_ns=1_000_000_007, names=('a', 'bcd'), values=np.array([1.5, -2.5]))
PARSERS = {
    'state': (parse_state, pack_state(VECTOR)),
    'command': (parse_command, pack_command(VECTOR)),
    'array': (
        parse_array,
        bytes(
            serialize_message(
                Float64MultiArray(
                    layout=MultiArrayLayout(dim=[MultiArrayDimension(label='abc')]), data=[1.0]
                )
            )
        ),
    ),
    'image': (parse_image, pack_image(7, np.ones((2, 3)), '64FC1')),
    'luminosity': (
        lambda message: luminosity_image(parse_image(message)),
        pack_image(7, np.ones((2, 3)), '64FC1'),
    ),
}


@pytest.mark.parametrize('kind', PARSERS)
def test_every_truncation_is_refused(kind):
    parse, message = PARSERS[kind]
    parse(message)
    for cut in range(len(message)):
        with pytest.raises(MessageError):
            parse(message[:cut])


@pytest.mark.parametrize('kind', PARSERS)
@given(data=st.data())
def test_corruption_gives_a_message_error_or_a_message(kind, data):
    parse, message = PARSERS[kind]
    corrupt = bytearray(message)
    for _ in range(data.draw(st.integers(1, 4))):
        octet = st.one_of(st.integers(0, 255), st.sampled_from([0, 1, 127, 128, 255]))
        corrupt[data.draw(st.integers(0, len(message) - 1))] = data.draw(octet)
    with contextlib.suppress(MessageError):
        parse(bytes(corrupt[: data.draw(st.integers(0, len(message)))]))


@given(st.permutations(range(1, 13)), st.sampled_from('ux'))
def test_numbered_entries_are_found_by_name_whatever_their_order(numbers, letter):
    message = pack_command(
        Vector(
            stamp_ns=7,
            names=tuple(f'{letter}{number}' for number in numbers),
            values=np.array(numbers, dtype=float),
        )
    )

    for _ in range(2):
        found = parse_command(message)
        assert found.names == tuple(f'{letter}{number}' for number in range(1, 13))
        np.testing.assert_array_equal(found.values, np.arange(1.0, 13.0))


@pytest.mark.parametrize('names', [('b', 'a'), ('u2', 'x1'), ('cart', 'u1'), ('u2', 'u')])
def test_entries_with_other_names_stand_as_they_are(names):
    message = pack_command(Vector(stamp_ns=0, names=names, values=np.array([1.0, 2.0])))

    assert parse_command(message).names == names
    assert parse_command(message).values.tolist() == [1.0, 2.0]
