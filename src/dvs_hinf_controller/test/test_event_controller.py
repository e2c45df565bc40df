"""Estimator and K against a reference that takes one event at a time by matrix exponentials."""

import dataclasses
import math

import numpy as np
import pytest
from controller_cases import (
    CONTROLLERS,
    HEIGHT,
    MS,
    PIXELS,
    PROBLEM,
    SECOND,
    WIDTH,
    OneAtATime,
    assert_same,
    courses,
    happenings,
    keyframe,
    packet,
    packets_of,
    running,
)
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import INDEX_MODULUS, EventPacket
from dvs_hinf_controller.running.reference_state import Synchrony


@pytest.mark.parametrize('name', CONTROLLERS)
@given(course=courses)
def test_a_packet_at_a_time_is_the_same_as_an_event_at_a_time(name, course):
    found, expected = running(CONTROLLERS[name]), OneAtATime(CONTROLLERS[name])

    for one in packets_of(course):
        report = found.take(one)
        expected.take(one)
        assert (report.lost_events, report.restarted) == (0, False)
        assert_same(found, expected)


@pytest.mark.parametrize('name', ['stable', 'defective', 'stiff', 'static'])
@given(course=st.lists(happenings, min_size=2, max_size=2))
def test_one_packet_of_twice_the_length_is_the_same_as_two(name, course):
    apart, together = running(CONTROLLERS[name]), running(CONTROLLERS[name])
    packets = packets_of(course)
    apart.take(packets[0])
    together.take(packets[0])

    for first, second in zip(packets[1::2], packets[2::2], strict=True):
        apart.take(first)
        apart.take(second)
        early = first.events.copy()
        early['t'] -= MS
        both = np.concatenate([early, second.events])
        together.take(EventPacket(stamp_ns=second.stamp_ns, events=both))
        assert_same(together, apart)


def test_counts_are_integers_that_never_drift():
    there_and_back = running()
    first = there_and_back.estimate.copy()
    index = 0
    for k in range(400):
        rows = [(0, 2, 1 if k % 2 else -1, 1)] * 3
        there_and_back.take(packet(k * MS, rows, index))
        index += 3

    np.testing.assert_array_equal(there_and_back.counts, np.zeros(PIXELS))
    np.testing.assert_array_equal(there_and_back.estimate, first)


def test_before_any_event_the_command_rests_on_the_first_estimate():
    found, expected = running(), OneAtATime(CONTROLLERS['stable'])

    np.testing.assert_allclose(found.estimate, expected.first, rtol=1e-12)
    np.testing.assert_allclose(found.command, expected.command, rtol=1e-12)


def test_the_first_packet_sets_the_clock():
    late, early = running(), running()

    late.take(packet(10**18, [(0, 0, 1, 1)]))
    early.take(packet(0, [(0, 0, 1, 1)]))

    np.testing.assert_array_equal(late.command, early.command)


def test_a_packet_with_the_same_stamp_adds_its_events_at_that_instant():
    twice, once = running(), running()
    for each in (twice, once):
        each.take(packet(0))

    twice.take(packet(MS, [(-5, 0, 1, 1)]))
    twice.take(packet(MS, [(0, 1, -1, 1)], first_index=1))
    once.take(packet(MS, [(-5, 0, 1, 1), (0, 1, -1, 1)]))

    assert_same(twice, once)


def test_an_event_from_before_the_last_packet_acts_from_that_packet_on():
    # A camera with latency or after a loss: K has passed that time already.
    found, expected = running(), running()
    for each in (found, expected):
        each.take(packet(0))
        each.take(packet(MS))

    found.take(packet(2 * MS, [(-int(1.5 * MS), 0, 1, 1)]))
    expected.take(packet(2 * MS, [(-MS, 0, 1, 1)]))

    assert_same(found, expected)


def test_a_stamp_that_does_not_follow_is_refused_and_changes_nothing():
    touched, untouched = running(), running()
    for each in (touched, untouched):
        each.take(packet(5 * SECOND))
        each.take(packet(5 * SECOND + MS, [(-MS, 0, 1, 1), (0, 3, -1, -1)]))

    for stamp_ns in (4 * SECOND, 15 * SECOND, 5 * SECOND):
        with pytest.raises(MessageError, match='s from the last events'):
            touched.take(packet(stamp_ns, [(0, 2, 1, 1)], first_index=2))

    following = packet(5 * SECOND + 2 * MS, [(-3, 2, 1, 1)], first_index=2)
    assert touched.take(following) == untouched.take(following)
    assert_same(touched, untouched, rtol=0)


@pytest.mark.parametrize('step_ns', [-4 * SECOND, 10 * SECOND])
def test_a_clock_that_has_stepped_leaves_unknown_references(step_ns):
    found = running()
    for k in range(3):
        found.take(packet(10 * SECOND + k * MS))
    for k in range(4):
        with pytest.raises(MessageError):
            found.take(packet(10 * SECOND + step_ns + k * MS))

    report = found.take(packet(10 * SECOND + step_ns + 4 * MS))

    assert report.restarted
    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.command, PROBLEM.equilibrium.feedforward)
    found.take_keyframe(keyframe(10 * SECOND + step_ns + 4 * MS, [0] * PIXELS, epoch=8))
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(found.estimate, running().estimate)


def test_a_sensor_that_starts_with_a_new_time_starts_everything_anew():
    again, fresh = running(), running()
    again.take(packet(0))
    again.take_keyframe(keyframe(0, [0] * PIXELS))
    for k in range(1, 30):
        again.take(packet(k * MS, [(-5, k % PIXELS, 1, 1)], first_index=k - 1))

    report = again.take_keyframe(keyframe(0, [0] * PIXELS, epoch=8, next_index=29))
    assert report.restarted
    again.take(packet(0, first_index=29))
    fresh.take(packet(0))
    assert_same(again, fresh, rtol=0)

    following = [(-MS // 3, 4, 1, 1)]
    assert again.take(packet(MS, following, first_index=29)).lost_events == 0
    fresh.take(packet(MS, following))
    assert_same(again, fresh, rtol=0)
    assert again.synchrony is Synchrony.EXACT


@pytest.mark.parametrize(
    ('before', 'first', 'lost'),
    [
        (None, 7, 7),
        (0, 1, 0),
        (0, 4, 3),
        (INDEX_MODULUS - 1, 0, 0),
        (INDEX_MODULUS - 1, 5, 5),
        (INDEX_MODULUS - 3, 1, 3),
    ],
)
def test_a_gap_in_the_index_is_a_loss(before, first, lost):
    found = running()
    found.take(packet(0))
    if before is not None:
        found.take(packet(MS, [(0, 0, 1, 1)], first_index=before))

    assert found.take(packet(2 * MS)).lost_events == 0
    assert found.take(packet(3 * MS, [(0, 0, 1, 1)], first_index=first)).lost_events == lost


def test_a_packet_received_twice_changes_nothing():
    found = running()
    found.take(packet(0))
    once = packet(MS, [(0, 0, 1, 1)])
    found.take(once)
    counts, estimate, command = found.counts, found.estimate.copy(), found.command.copy()

    assert found.take(once).repeated
    np.testing.assert_array_equal(found.counts, counts)
    np.testing.assert_array_equal(found.estimate, estimate)
    np.testing.assert_array_equal(found.command, command)
    assert found.take(packet(2 * MS, [(0, 0, 1, 1)], first_index=1)).lost_events == 0


BAD = {
    'x outside': ('x', WIDTH, 'outside of the 3 x 2 pixels'),
    'y outside': ('y', HEIGHT, 'outside of the 3 x 2 pixels'),
    'after the stamp': ('t', 1, "nor exceed the packet's stamp"),
    'out of order': ('t', -MS + 1, 'must not decrease'),
    'no polarity': ('polarity', 0, r'must be \+1 or -1'),
    'polarity 2': ('polarity', 2, r'must be \+1 or -1'),
    'polarity -128': ('polarity', -128, r'must be \+1 or -1'),
    'no sign': ('sign', 0, r'must be \+1 or -1'),
}


@pytest.mark.parametrize('kind', BAD)
def test_a_packet_that_is_refused_changes_nothing(kind):
    field, value, reason = BAD[kind]
    touched, untouched = running(), running()
    for each in (touched, untouched):
        each.take(packet(0))
        each.take(packet(MS, [(-7, 1, 1, 1)]))
    bad = packet(2 * MS, [(-9, 0, 1, 1), (-5, 5, -1, 1)], first_index=1)
    bad.events[field][1] = value

    with pytest.raises(MessageError, match=reason):
        touched.take(bad)

    following = packet(3 * MS, [(-3, 2, 1, 1)], first_index=1)
    assert touched.take(following) == untouched.take(following)
    assert_same(touched, untouched, rtol=0)


def test_the_command_is_limited_input_by_input():
    free = running()
    limits = np.abs(free.command) * [0.5, 2.0]
    limited = running(limit=limits)

    np.testing.assert_allclose(limited.command[0], math.copysign(limits[0], free.command[0]))
    assert limited.command[1] == free.command[1]


def test_a_limited_command_is_that_of_k_within_the_limits():
    limited, free = running(limit=1e-3), running()
    for each in (limited, free):
        each.take(packet(0))

    np.testing.assert_allclose(limited.command, np.clip(free.command, -1e-3, 1e-3), rtol=0)


def test_another_set_point_keeps_what_is_known_of_the_pixels():
    moved = dataclasses.replace(
        PROBLEM, equilibrium=PROBLEM.model.equilibrium([0.3, -0.1], tolerance=1e-9)
    )
    found, before = running(), running()
    for each in (found, before):
        each.take(packet(0))
        each.take(packet(MS, [(-5, 2, 1, 1)]))

    found.redirect(moved, CONTROLLERS['stable'])

    np.testing.assert_array_equal(found.estimate, before.estimate)
    # c'x_d grows by 0.2, the feedforward -A x_d by (-0.2, 0).
    change = -0.2 * CONTROLLERS['stable'].feedthrough + [-0.2, 0]
    np.testing.assert_allclose(found.command, before.command + change, rtol=1e-12)


def test_counts_beyond_any_physical_luminosity_are_refused_and_count_as_lost():
    controller = running()
    controller.take(packet(0))
    before = controller.estimate.copy()

    with pytest.raises(MessageError, match='the luminosity is not physically possible'):
        controller.take(packet(MS, [(k - 5000, 0, 1, 1) for k in range(5000)]))

    assert np.array_equal(controller.estimate, before)
    assert np.isfinite(controller.command).all()
    assert controller.take(packet(2 * MS, [(0, 0, 1, 1)], 5000)).lost_events == 5000
    assert controller.synchrony is Synchrony.LOST
