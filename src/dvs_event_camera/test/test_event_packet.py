"""The mono encoding bit by bit, and both ways."""

import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.wire.events import EventPacket, make_events
from dvs_event_camera.streams.event_packet import (
    encode_mono,
    pack_event_packet,
    parse_event_packet,
)
from dvs_event_camera.streams.packet_decoder import PacketDecoder


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
    packet = packet_of(stamp, t, x, y, [1 if o else -1 for o in on])
    message = pack_event_packet(packet, height=480, width=640, sequence=2**40)
    driver = parse_event_packet(message)
    assert (driver.sequence, driver.width, driver.height) == (2**40, 640, 480)
    assert driver.stamp_ns == (t[0] if t else 0)
    found = PacketDecoder().decode(driver)
    assert found.t.tolist() == list(t)
    assert found.x.tolist() == list(x)
    assert found.y.tolist() == list(y)
    assert found.p.tolist() == list(on)
