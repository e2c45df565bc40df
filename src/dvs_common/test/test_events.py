"""The event packet: its layout bit by bit, to and from rclpy's PointCloud2."""

import array
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import (
    EVENT_DTYPE,
    INDEX_MODULUS,
    LABELLED_EVENT_DTYPE,
    LONGEST_INTERVAL_NS,
    EventPacket,
    event_times_ns,
    make_events,
    pack_events,
    parse_events,
)

stamps = st.integers(0, 2**31 * 10**9 - 1)
columns = st.lists(
    st.tuples(
        st.integers(0, 2**16 - 1),
        st.integers(0, 2**16 - 1),
        st.integers(-LONGEST_INTERVAL_NS, 0),
        st.sampled_from([1, -1]),
        st.sampled_from([1, -1]),
    ),
    max_size=20,
)


def some_events(count=3, dtype=EVENT_DTYPE):
    events = np.zeros(count, dtype)
    for column, name in enumerate(events.dtype.names):
        events[name] = np.arange(count) + 2 * column
    return events


def made(events, *, width=2**16, stamp_ns=2**40, first_index=0):
    x, y, t, polarity, sign = (np.array(column) for column in zip(*events, strict=True))
    return make_events(
        times_ns=stamp_ns + t.astype(np.int64),
        pixels=y.astype(np.int64) * width + x,
        polarities=polarity.astype(np.int8),
        signs=sign.astype(np.int8),
        width=width,
        stamp_ns=stamp_ns,
        first_index=first_index,
    )


def test_a_record_has_the_published_layout():
    record = made([(0x0102, 0x0304, -5, -1, 1)], first_index=0x0A0B0C0D)

    assert record.tobytes() == struct.pack('<HHiIbbxx', 0x0102, 0x0304, -5, 0x0A0B0C0D, -1, 1)
    assert record.dtype == EVENT_DTYPE


def test_a_label_stands_in_the_padding():
    assert {**LABELLED_EVENT_DTYPE.fields, **EVENT_DTYPE.fields} == LABELLED_EVENT_DTYPE.fields
    assert LABELLED_EVENT_DTYPE.fields['noise'] == (np.dtype('u1'), 14)
    assert LABELLED_EVENT_DTYPE.itemsize == EVENT_DTYPE.itemsize == 16


@given(columns.filter(len), stamps, st.integers(0, 2**40))
def test_made_records_hold_their_columns(events, stamp_ns, first_index):
    records = made(events, stamp_ns=stamp_ns, first_index=first_index)

    for name, column in zip(
        ('x', 'y', 't', 'polarity', 'sign'), zip(*events, strict=True), strict=True
    ):
        np.testing.assert_array_equal(records[name], column)
    expected = [(first_index + k) % INDEX_MODULUS for k in range(len(events))]
    np.testing.assert_array_equal(records['index'], expected)


def test_the_index_wraps_around():
    records = made([(0, 0, 0, 1, 1)] * 4, first_index=3 * INDEX_MODULUS - 2)

    assert records['index'].tolist() == [INDEX_MODULUS - 2, INDEX_MODULUS - 1, 0, 1]
    assert records['polarity'].tolist() == [1, 1, 1, 1]


def test_no_events_make_an_empty_array():
    empty = np.empty(0)
    records = make_events(
        times_ns=empty.astype(np.int64),
        pixels=empty.astype(np.int64),
        polarities=empty.astype(np.int8),
        signs=empty.astype(np.int8),
        width=3,
        stamp_ns=5,
        first_index=0,
    )

    assert records.shape == (0,)
    assert records.dtype == EVENT_DTYPE


@pytest.mark.parametrize('dtype', [EVENT_DTYPE, LABELLED_EVENT_DTYPE], ids=['plain', 'labelled'])
@given(stamp_ns=stamps, count=st.integers(0, 5))
def test_rclpy_reads_our_packet_and_we_do(dtype, stamp_ns, count):
    events = some_events(count, dtype)
    packed = pack_events(EventPacket(stamp_ns=stamp_ns, events=events))

    message = deserialize_message(packed, PointCloud2)

    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == stamp_ns
    assert message.header.frame_id == 'pixels'
    assert (message.height, message.width) == (1, count)
    assert (message.point_step, message.row_step) == (16, 16 * count)
    assert (message.is_bigendian, message.is_dense) == (False, True)
    assert bytes(message.data) == events.tobytes()
    sizes = {PointField.INT8: 1, PointField.UINT8: 1, PointField.UINT16: 2}
    sizes |= {PointField.INT32: 4, PointField.UINT32: 4}
    described = {f.name: (f.offset, sizes[f.datatype], f.count) for f in message.fields}
    assert described == {
        name: (offset, kind.itemsize, 1) for name, (kind, offset) in dtype.fields.items()
    }
    found = parse_events(packed)
    assert found.stamp_ns == stamp_ns
    assert found.events.dtype == dtype
    assert found.events.tobytes() == events.tobytes()


def point_cloud(events, **changes):
    """The packet as another program would publish it: other order, another frame."""
    kinds = {'u2': PointField.UINT16, 'i4': PointField.INT32, 'u4': PointField.UINT32}
    kinds |= {'i1': PointField.INT8, 'u1': PointField.UINT8}
    fields = [
        PointField(name=name, offset=offset, datatype=kinds[kind.str[1:]], count=1)
        for name, (kind, offset) in reversed(events.dtype.fields.items())
    ]
    message = PointCloud2(height=1, width=len(events), fields=fields, point_step=16)
    message.header.frame_id = 'camera_optical_frame'
    message.header.stamp.sec = 3
    message.row_step = 16 * len(events)
    message.data = array.array('B', events.tobytes())
    for name, value in changes.items():
        setattr(message, name, value)
    return bytes(serialize_message(message))


@given(st.integers(0, 4), st.binary(max_size=3))
def test_we_read_rclpys_packet(count, tail):
    events = some_events(count)

    packet = parse_events(point_cloud(events) + tail)

    assert packet.stamp_ns == 3 * 10**9
    assert packet.events.tobytes() == events.tobytes()


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'fields': []}, 'are not those of an event packet'),
        ({'is_bigendian': True}, 'little-endian'),
        ({'point_step': 12}, 'point_step 12 must be 16'),
        ({'width': 4}, '4 events do not fit 48 bytes'),
        ({'height': 2}, '6 events do not fit 48 bytes'),
    ],
)
def test_a_point_cloud_of_another_kind_is_refused(changes, reason):
    with pytest.raises(MessageError, match=reason):
        parse_events(point_cloud(some_events(), **changes))


PACKED = pack_events(EventPacket(stamp_ns=5, events=some_events()))


def test_every_truncation_is_refused():
    # Three bytes fill the last word up.
    parse_events(PACKED[:-3])
    for cut in range(len(PACKED) - 3):
        with pytest.raises(MessageError):
            parse_events(PACKED[:cut])


@given(st.data())
def test_corruption_gives_a_message_error_or_a_packet(data):
    corrupt = bytearray(PACKED)
    for _ in range(data.draw(st.integers(1, 4))):
        octet = st.one_of(st.integers(0, 255), st.sampled_from([0, 1, 127, 128, 255]))
        corrupt[data.draw(st.integers(0, len(PACKED) - 1))] = data.draw(octet)
    try:
        packet = parse_events(bytes(corrupt))
    except MessageError:
        return
    assert packet.events.dtype in (EVENT_DTYPE, LABELLED_EVENT_DTYPE)


def test_event_times_are_absolute_whatever_form_a_packet_has():
    stamp_ns = 1_700_000_000_000_000_005
    t = [-LONGEST_INTERVAL_NS, -1, 0]
    packet = EventPacket(
        stamp_ns=stamp_ns, events=made([(k, 0, t[k], 1, 1) for k in range(3)], stamp_ns=stamp_ns)
    )
    message = pack_events(packet)
    expected = [stamp_ns + value for value in t]

    for form in (packet, message, deserialize_message(message, PointCloud2)):
        times = event_times_ns(form)
        assert times.dtype == np.int64
        assert times.tolist() == expected
    with pytest.raises(MessageError, match='not those of an event packet'):
        event_times_ns(PointCloud2(point_step=16))
