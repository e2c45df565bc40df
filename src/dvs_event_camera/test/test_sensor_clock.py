"""Sensor time to ROS time: never back, never overlapping, and straight in spite of jitter."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_encoders import SAMPLES

from dvs_event_camera.files.open_recording import open_recording
from dvs_event_camera.streams.sensor_clock import SensorClock

MS = 10**6
EPOCH = 1_700_000_000_000_000_000


def drive(packets, clock=None):
    """Dates of packets of (sensor times, stamp)."""
    clock = clock or SensorClock()
    return [clock.dates(np.asarray(times, np.int64), stamp) for times, stamp in packets]


def jittered(seconds, *, drift=0.0, jitter_ms=2.0, period_ms=10, seed=0):
    """Packets of a sensor whose clock drifts, received with a delay that jitters."""
    rng = np.random.default_rng(seed)
    packets = []
    for k in range(int(seconds * 1000 / period_ms)):
        first = k * period_ms * MS
        times = first + np.linspace(0, period_ms * MS - 1000, 20).astype(np.int64)
        true = EPOCH + round(first * (1 + drift))
        packets.append((times, true + 3 * MS + round(rng.exponential(jitter_ms * MS))))
    return packets


@pytest.mark.ensemble
@pytest.mark.parametrize('drift', [0.0, 50e-6, -80e-6])
def test_a_jittered_stream_becomes_a_straight_line(drift):
    packets = jittered(90, drift=drift)
    dates = drive(packets)

    naive = [times - times[0] + stamp for times, stamp in packets]
    overlaps = sum(b[0] <= a[-1] for a, b in pairwise(naive))
    assert overlaps > 100
    flat = np.concatenate(dates)
    assert np.all(np.diff(flat) > 0)
    # From ten seconds on the time given out is the true one and the least delay, within 0.2 ms.
    late = [k for k, (times, _) in enumerate(packets) if times[0] > 10 * 10**9]
    true = np.array([EPOCH + 3 * MS + round(packets[k][0][0] * (1 + drift)) for k in late])
    error = np.array([dates[k][0] for k in late]) - true
    assert np.abs(error).max() < 0.2 * MS


@given(
    st.lists(
        st.tuples(st.integers(0, 50 * MS), st.integers(0, 20 * MS), st.integers(0, 30 * MS)),
        min_size=1,
        max_size=60,
    )
)
@settings(deadline=None, max_examples=100)
def test_whatever_the_jitter_time_never_goes_back(steps):
    sensor, packets = 0, []
    for gap, length, delay in steps:
        sensor += gap
        packets.append((np.array([sensor, sensor + length]), EPOCH + sensor + delay))
        sensor += length
    dates = np.concatenate(drive(packets))

    assert np.all(np.diff(dates) >= 0)
    # Never ahead of a stamp by more than what a packet may be late.
    assert dates[0] == packets[0][1]


def test_a_slow_first_packet_is_made_good_at_two_percent():
    packets = jittered(3, jitter_ms=0)
    packets[0] = (packets[0][0], packets[0][1] + 20 * MS)
    dates = drive(packets)

    lengths = np.array(
        [(d[-1] - d[0]) / (t[-1] - t[0]) for d, (t, _) in zip(dates, packets, strict=True)]
    )
    assert lengths[1] == pytest.approx(0.98, abs=1e-3)
    assert lengths[-1] == pytest.approx(1, abs=1e-6)
    assert dates[-1][0] == packets[-1][1]


def test_a_sensor_that_starts_again_goes_on_in_ros_time():
    first = jittered(2, jitter_ms=0)
    again = [(times, stamp + 5 * 10**9) for times, stamp in jittered(1, jitter_ms=0)]
    dates = drive(first + again)

    assert dates[len(first)][0] == again[0][1]
    assert np.all(np.diff(np.concatenate(dates)) > 0)


def test_a_ros_clock_that_is_set_back_is_followed_at_once():
    first = jittered(2, jitter_ms=0)
    times, stamp = jittered(2.05, jitter_ms=0)[-1]

    dates = drive([*first, (times, stamp - 3600 * 10**9)])

    assert dates[-1][0] == stamp - 3600 * 10**9


def test_a_packet_without_events_gets_no_dates():
    clock = SensorClock()

    assert clock.dates(np.empty(0, np.int64), EPOCH).size == 0


@pytest.mark.skipif(not SAMPLES.exists(), reason='no recordings here')
@pytest.mark.parametrize('name', ['ecp_test_events_2', 'codecs_evt3_trigger'])
def test_recorded_packets_neither_overlap_nor_go_back(name):
    packets = [
        (stretch.events.t, stretch.stamp_ns)
        for stretch in open_recording(SAMPLES / name).read()
        if len(stretch.events)
    ]
    naive = [times - times[0] + stamp for times, stamp in packets]
    assert any(b[0] < a[-1] for a, b in pairwise(naive))

    dates = drive(packets)

    assert all(np.all(np.diff(d) >= 0) for d in dates)
    assert all(b[0] >= a[-1] for a, b in pairwise(dates))
    # Two crystals: what differs from the sensor's own time is the jitter of the first packets.
    given = np.concatenate(dates) - np.concatenate([times for times, _ in packets])
    assert np.ptp(given[len(given) // 2 :]) < 0.5 * MS
