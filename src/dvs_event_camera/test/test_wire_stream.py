"""A sensor's events as packets of the wire contract: cropped, sorted, stamped, numbered."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_encoders import SAMPLES, mono_words, packet_message, some_events

from dvs_common.errors import ParameterError
from dvs_common.wire.events import LABELLED_EVENT_DTYPE, pack_events, parse_events
from dvs_common.wire.index_watch import IndexWatch, Order
from dvs_event_camera.files.bag_file import BagFile
from dvs_event_camera.streams.packet_bridge import PacketBridge
from dvs_event_camera.streams.pixel_map import PixelMap
from dvs_event_camera.streams.sensor_events import SensorEvents, no_events
from dvs_event_camera.streams.wire_stream import WireStream

S = 10**9


def columns(t, x, y, p, noise=None):
    return SensorEvents(
        t=np.array(t, np.int64),
        x=np.array(x, np.uint16),
        y=np.array(y, np.uint16),
        p=np.array(p, np.uint8),
        noise=None if noise is None else np.array(noise, np.uint8),
    )


def rows(packets):
    """Absolute (t, y, x, polarity) of all events."""
    found = []
    for packet in packets:
        e = packet.events
        t = packet.stamp_ns + e['t'].astype(np.int64)
        found += zip(
            t.tolist(), e['y'].tolist(), e['x'].tolist(), e['polarity'].tolist(), strict=True
        )
    return found


@given(
    st.lists(
        st.tuples(
            st.integers(0, 6 * S),
            st.integers(0, 65535),
            st.integers(0, 65535),
            st.booleans(),
            st.booleans(),
        ),
        max_size=40,
    )
)
@settings(deadline=None, max_examples=200)
def test_packets_hold_all_events_sorted_and_numbered(listed):
    t, y, x, on, noise = zip(*listed, strict=True) if listed else ((), (), (), (), ())
    packets = WireStream().packets(columns(t, x, y, on, noise), 6 * S)

    assert rows(packets) == sorted((t, y, x, 2 * on - 1) for t, y, x, on, _ in listed)
    assert packets[-1].stamp_ns == 6 * S
    assert all(np.all(p.events['t'] <= 0) for p in packets)
    assert all(b.stamp_ns > a.stamp_ns for a, b in pairwise(packets))
    index = np.concatenate([p.events['index'] for p in packets])
    assert index.tolist() == list(range(len(listed)))
    labels = [n for p in packets if len(p.events) for n in p.events['noise'].tolist()]
    assert sum(labels) == sum(noise)
    for packet in packets:
        assert parse_events(pack_events(packet)).stamp_ns == packet.stamp_ns
        assert packet.events.dtype == LABELLED_EVENT_DTYPE or not len(packet.events)


def test_stamps_rise_whatever_the_times_and_a_new_start_goes_back():
    stream = WireStream()
    watch = IndexWatch()
    stamps, orders = [], []
    for t, end in (([5, 9], 10), ([3, 12], 12), ([], 12), ([2 * S], 2 * S), ([7], 8)):
        for packet in stream.packets(columns(t, [0] * len(t), [0] * len(t), [1] * len(t)), end):
            orders.append(watch.take(packet).order)
            stamps.append(packet.stamp_ns)

    assert stamps == [10, 12, 13, 2 * S, 8]
    assert orders[:4] == [Order.IN_ORDER] * 4
    assert orders[4] is Order.GONE_BACK
    assert watch.lost == 0


def test_a_loss_is_a_gap_in_the_numbers():
    stream, watch = WireStream(), IndexWatch()
    watch.take(stream.packets(columns([1], [0], [0], [1]), 1)[0])
    stream.note_loss()
    step = watch.take(stream.packets(columns([2], [0], [0], [1]), 2)[0])

    assert (step.order, step.lost) == (Order.LOST, 1)


def test_region_bins_and_mask_by_counting_one_pixel_at_a_time():
    pixel_map = PixelMap(region=(10, 20, 7, 6), binning=3, masked=(11, 21, 15, 25))
    y, x = np.mgrid[0:40, 0:30]
    events = columns(np.arange(x.size), x.ravel(), y.ravel(), np.ones(x.size))

    found = pixel_map.mapped(events, 30, 40)

    expected = [
        (t, (a - 10) // 3, (b - 20) // 3)
        for t, a, b in zip(events.t.tolist(), x.ravel().tolist(), y.ravel().tolist(), strict=True)
        if 10 <= a < 16 and 20 <= b < 26 and (a, b) not in ((11, 21), (15, 25))
    ]
    assert list(zip(found.t, found.x, found.y, strict=True)) == expected
    assert pixel_map.size(30, 40) == (2, 2)


def test_no_map_keeps_everything_and_an_event_beyond_the_sensor_is_left_out():
    events = some_events(100, width=20, height=10)

    assert len(PixelMap().mapped(events, 20, 10)) == 100
    assert len(PixelMap().mapped(events, 15, 10)) == np.count_nonzero(events.x < 15)


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('region', {'region': (1, 2, 3)}),
        ('region', {'region': (-1, 0, 3, 3)}),
        ('region', {'region': (0, 0, 0, 3)}),
        ('binning', {'binning': 0}),
        ('binning', {'region': (0, 0, 3, 9), 'binning': 4}),
        ('masked_pixels', {'masked': (1,)}),
    ],
)
def test_a_map_that_can_not_be_is_refused_by_name(name, arguments):
    with pytest.raises(ParameterError, match=f'^{name} = '):
        PixelMap(**arguments)
    with pytest.raises(ParameterError, match='beyond the 20 x 10 pixels'):
        PixelMap(region=(15, 0, 6, 2)).mapped(no_events(), 20, 10)


def test_a_stream_of_640_by_480_pixels_drives_three_or_256():
    events = some_events(20_000, width=640, height=480)
    base = int(events.t[0])
    message = packet_message(
        mono_words(events, base), 'mono', stamp_ns=S, time_base=base, width=640, height=480
    )
    for pixel_map, size in (
        (PixelMap(region=(200, 300, 3, 1)), (3, 1)),
        (PixelMap(region=(0, 0, 639, 213), binning=213), (3, 1)),
        (PixelMap(region=(80, 0, 480, 480), binning=30), (16, 16)),
    ):
        packets = PacketBridge(pixel_map).take(message)
        found = np.concatenate([packet.events for packet in packets])
        assert pixel_map.size(640, 480) == size
        left, top, width, height = pixel_map.region
        inside = (
            (events.x >= left)
            & (events.x < left + width)
            & (events.y >= top)
            & (events.y < top + height)
        )
        assert len(found) == np.count_nonzero(inside)
        assert set(found['x']) <= set(range(size[0]))
        assert set(found['y']) <= set(range(size[1]))


@pytest.mark.skipif(not SAMPLES.exists(), reason='no recordings here')
@pytest.mark.parametrize('name', ['ecp_test_events_2', 'codecs_evt3_trigger'])
def test_a_recorded_stream_has_no_restart_and_no_loss(name):
    bridge, watch = PacketBridge(PixelMap(region=(100, 100, 16, 16))), IndexWatch()
    orders = set()
    with BagFile(SAMPLES / name) as bag:
        for message in bag.messages():
            orders |= {watch.take(packet).order for packet in bridge.take(message.data)}
            assert bridge.notice == ''

    assert orders == {Order.IN_ORDER}
    assert watch.events > 0


def test_a_drivers_message_without_events_moves_time_on():
    bridge = PacketBridge(PixelMap())
    events = some_events(20)
    stamp_ns = 10**18
    message = packet_message(mono_words(events, 0), 'mono', stamp_ns=stamp_ns, sequence=0)
    first = bridge.take(message)[-1].stamp_ns
    later = stamp_ns + 100_000_000

    (silent,) = bridge.take(packet_message([], 'mono', stamp_ns=later, sequence=1))

    assert first < silent.stamp_ns == later
    assert len(silent.events) == 0
