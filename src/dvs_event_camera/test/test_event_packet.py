"""The mono encoding bit by bit, and both ways."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.wire.cdr import CdrWriter, MessageError
from dvs_common.wire.events import EventPacket, make_events
from dvs_event_camera.streams.event_packet import (
    decode_mono,
    encode_mono,
    pack_event_packet,
    parse_event_packet,
)


def packet_of(stamp_ns, times, x, y, polarity, width=640, first_index=0):
    return EventPacket(
        stamp_ns=stamp_ns,
        events=make_events(
            times_ns=np.array(times, np.int64),
            pixels=np.array(y, np.int64) * width + np.array(x, np.int64),
            polarities=np.array(polarity, np.int8),
            signs=np.ones(len(times), np.int8),
            width=width,
            stamp_ns=stamp_ns,
            first_index=first_index,
        ),
    )


def test_bits_are_where_the_drivers_put_them():
    packet = packet_of(5_000, [4_000, 4_300, 5_000], [3, 639, 0], [7, 479, 1], [1, -1, 1])
    time_base, words = encode_mono(packet)
    assert time_base == 4_000
    assert [int(word) for word in words] == [
        (1 << 63) | (7 << 48) | (3 << 32) | 0,
        (479 << 48) | (639 << 32) | 300,
        (1 << 63) | (1 << 48) | (0 << 32) | 1_000,
    ]


def test_message_is_laid_out_as_event_packet_msg():
    packet = packet_of(3_000_000_500, [3_000_000_500], [2], [1], [-1], width=4)
    message = pack_event_packet(packet, height=3, width=4, sequence=9)
    assert message[:4] == b'\x00\x01\x00\x00'
    body = message[4:]
    assert struct.unpack_from('<iII', body) == (3, 500, 7)
    assert body[12:19] == b'pixels\x00'
    assert struct.unpack_from('<II', body, 20) == (3, 4)
    assert struct.unpack_from('<QQ', body, 32) == (9, 3_000_000_500)
    assert struct.unpack_from('<I', body, 48) == (5,)
    assert body[52:57] == b'mono\x00'
    assert body[57] == 0
    assert struct.unpack_from('<IQ', body[:60] + body[60:], 60) == (8, 1 << 48 | 2 << 32)
    assert len(body) == 72


@given(
    st.lists(
        st.tuples(st.integers(0, 10**6), st.integers(0, 639), st.integers(0, 479), st.booleans()),
        max_size=30,
    )
)
@settings(deadline=None)
def test_there_and_back(events):
    events = sorted({(t, y, x): (t, y, x, on) for t, x, y, on in events}.values())
    stamp = 10**6 if events else 0
    t, y, x, on = zip(*events, strict=True) if events else ((), (), (), ())
    packet = packet_of(stamp, t, x, y, [1 if o else -1 for o in on], first_index=11)
    message = pack_event_packet(packet, height=480, width=640, sequence=2**40)
    found, sequence = parse_event_packet(message, first_index=11)
    assert sequence == 2**40
    assert found.stamp_ns == (t[-1] if t else 0)
    for field in ('x', 'y', 'index', 'polarity', 'sign'):
        assert np.array_equal(found.events[field], packet.events[field])
    assert np.array_equal(found.stamp_ns + found.events['t'], stamp + packet.events['t'])


def test_packet_of_a_driver_is_put_in_order():
    words = np.array([1 << 63 | 5 << 32 | 7, 2 << 32 | 7, 9 << 32 | 3], np.uint64)
    packet = decode_mono(words, time_base=100, width=10, first_index=0)
    assert packet.stamp_ns == 107
    assert packet.events['x'].tolist() == [9, 2, 5]
    assert packet.events['t'].tolist() == [-4, 0, 0]
    assert packet.events['polarity'].tolist() == [-1, -1, 1]


def test_what_is_not_mono_is_refused():
    def message(encoding, data):
        writer = CdrWriter()
        writer.stamp(0)
        writer.text('')
        writer.u32(10)
        writer.u32(10)
        writer.u64(0)
        writer.u64(0)
        writer.text(encoding)
        writer.u8(0)
        writer.octets(data)
        return writer.finish()

    for broken in (message('evt3', b''), message('mono', b'1234567'), message('mono', b'')[:-2]):
        with pytest.raises(MessageError):
            parse_event_packet(broken)
    outside = struct.pack('<Q', 10 << 32)
    with pytest.raises(MessageError, match='x = 10'):
        parse_event_packet(message('mono', outside))
    long = struct.pack('<QQ', 0, 0xFFFFFFFF)
    with pytest.raises(MessageError, match='spans'):
        parse_event_packet(message('mono', long))
