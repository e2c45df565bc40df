"""One answer to what the running event number shows: in order, lost, repeated or gone back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.events import EVENT_DTYPE, INDEX_MODULUS, EventPacket
from dvs_common.wire.index_watch import IndexWatch, Order

MS = 1_000_000


def packet(stamp_ns, *indices):
    events = np.zeros(len(indices), EVENT_DTYPE)
    events['index'] = np.array(indices, dtype=np.int64) % INDEX_MODULUS
    events['polarity'] = 1
    return EventPacket(stamp_ns=stamp_ns, events=events)


def steps_of(watch, packets):
    steps = [watch.take(one) for one in packets]
    return [(step.order, step.lost) for step in steps]


@given(
    first=st.integers(0, INDEX_MODULUS - 1),
    sent=st.lists(st.integers(0, 5), min_size=1, max_size=20),
    kept=st.lists(st.booleans(), min_size=20, max_size=20),
)
def test_what_is_missing_is_counted_at_the_next_event_also_where_the_number_wraps(
    first, sent, kept
):
    watch = IndexWatch(expected=first)
    index, missing, received = first, 0, 0
    for k, (count, received_it) in enumerate(zip(sent, kept, strict=False)):
        whole = packet(k * MS, *range(index, index + count))
        index += count
        if not received_it:
            missing += count
            continue
        expected = missing if count else 0
        missing -= expected
        received += count
        assert watch.take(whole).lost == expected
    assert (watch.events, watch.on_events) == (received, received)
    assert watch.lost + missing + received == sum(sent)
    assert (watch.restarts, watch.repeated) == (0, 0)


def test_gaps_are_counted_once_each():
    watch = IndexWatch()
    packets = [packet(0, -2, -1, 0), packet(MS, 1, 2), packet(2 * MS), packet(3 * MS, 8, 9)]

    assert [step[1] for step in steps_of(watch, packets)] == [0, 0, 0, 5]
    assert (watch.lost, watch.gaps, watch.first_index) == (5, 1, INDEX_MODULUS - 2)


def test_a_number_missing_within_a_packet_is_a_loss():
    assert steps_of(IndexWatch(), [packet(0, 3, 4, 9)]) == [(Order.LOST, 4)]


@pytest.mark.parametrize(
    'back', [packet(MS, 4), packet(MS, 9, 10), packet(0, 0), packet(MS, 11, 10, 12)]
)
def test_a_number_that_goes_back_is_a_restart_and_never_four_thousand_million_lost(back):
    watch = IndexWatch()

    found = steps_of(
        watch, [packet(0, 9, 10), back, packet(2 * MS, int(back.events['index'][-1]) + 1)]
    )

    assert found[1] == (Order.GONE_BACK, 0)
    assert found[2] == (Order.IN_ORDER, 0)
    assert (watch.restarts, watch.lost) == (1, 0)


def test_a_stamp_that_goes_back_is_a_restart_whatever_the_number():
    for later in (packet(0, 3), packet(0, 900), packet(0)):
        assert steps_of(IndexWatch(), [packet(MS, 2), later])[1] == (Order.GONE_BACK, 0)


def test_a_packet_received_twice_is_named_and_its_events_count_once():
    watch = IndexWatch()

    found = steps_of(watch, [packet(0, 0, 1), packet(MS, 2, 3), packet(MS, 2, 3), packet(MS, 4)])

    assert found[2:] == [(Order.REPEATED, 0), (Order.IN_ORDER, 0)]
    assert (watch.events, watch.repeated, watch.restarts, watch.lost) == (5, 1, 0, 0)
