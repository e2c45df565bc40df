"""What keyframes give the running controller: counts, thresholds, and starts of the sensor."""

import dataclasses

import numpy as np
import pytest
from controller_cases import (
    CONTROLLERS,
    COURSE,
    LOWER,
    MS,
    PIXELS,
    PROBLEM,
    SECOND,
    UPPER,
    H,
    initial_estimate,
    keyframe,
    keyframe_after,
    packet,
    packets_of,
    running,
)

from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_hinf_controller.running.event_controller import EventController, PacketReport
from dvs_hinf_controller.running.reference_state import Synchrony


@pytest.mark.parametrize('given', [2, 3, 4, 5], ids='given at {}'.format)
@pytest.mark.parametrize('about', [3, 4], ids='about {}'.format)
def test_a_keyframe_puts_the_counts_right_after_a_loss(given, about):
    packets = packets_of(COURSE)
    whole, lossy = running(), running()
    for number, one in enumerate(packets):
        whole.take(one)
        if number != 2:
            lossy.take(one)
        if number == given:
            lossy.take_keyframe(keyframe_after(packets[: about + 1]))

    assert lossy.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(lossy.counts, whole.counts)
    np.testing.assert_array_equal(lossy.estimate, whole.estimate)


def test_a_keyframe_confirms_what_was_counted():
    packets = packets_of(COURSE)
    found = running()
    assert found.synchrony is Synchrony.UNVERIFIED
    for one in packets:
        found.take(one)

    assert found.take_keyframe(keyframe_after(packets)).resynchronised_pixels == 0
    assert found.synchrony is Synchrony.EXACT


def test_a_keyframe_of_another_array_is_refused():
    with pytest.raises(MessageError, match='keyframe of 2 pixels, the array has 6'):
        given = keyframe(0, [0] * PIXELS)
        running().take_keyframe(dataclasses.replace(given, counts=np.zeros(2, np.int64)))


def test_a_keyframe_gives_the_references_of_when_counting_began():
    found = running()
    first = found.estimate.copy()
    found.take(packet(MS, [], 0))
    moved = np.linspace(-1, 1, PIXELS)

    assert found.take_keyframe(keyframe(MS, np.arange(PIXELS), moved=moved)) == PacketReport(
        resynchronised_pixels=PIXELS
    )
    growth = PROBLEM.log_base ** (moved + np.arange(PIXELS) * H)
    np.testing.assert_allclose(found.estimate, first * growth, rtol=1e-14)


def test_a_loss_that_no_index_has_shown_is_found_by_a_keyframe():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take(packet(MS, [(0, 0, 1, 1)]))
    found.take(packet(3 * MS))

    assert found.take_keyframe(keyframe(2 * MS, [1, 1, 0, 0, 0, 0], next_index=2)) == PacketReport(
        resynchronised_pixels=1
    )
    assert found.synchrony is Synchrony.EXACT
    assert found.take(packet(4 * MS, [(0, 0, 1, 1)], first_index=2)).lost_events == 0
    assert found.counts.tolist() == [2, 1, 0, 0, 0, 0]


def test_a_controller_that_starts_within_an_epoch_knows_no_reference_until_the_next_keyframe():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(SECOND, [(0, 0, 1, 1)], first_index=40))
    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.command, PROBLEM.equilibrium.feedforward)

    found.take_keyframe(keyframe(SECOND, np.arange(PIXELS), next_index=41, age_s=1.0))

    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_array_equal(found.counts, np.arange(PIXELS))


def test_unknown_references_hold_the_last_command_or_the_equilibrium_input():
    for holds in (False, True):
        found = EventController(
            PROBLEM,
            CONTROLLERS['stable'],
            event_threshold=H,
            command_limit=np.full(2, np.inf),
            holds_unknown=holds,
        )
        found.take(packet(0))
        found.take(packet(MS, [(-5, 0, 1, 1)], first_index=0))
        last = found.command.copy()
        found.take(packet(2 * MS, [(-5, 0, 1, 1)], first_index=0))
        assert found.synchrony is Synchrony.UNKNOWN
        expected = last if holds else PROBLEM.equilibrium.feedforward
        np.testing.assert_allclose(found.command, expected, rtol=1e-2)
        if not holds:
            np.testing.assert_array_equal(found.command, expected)


def test_a_new_threshold_starts_from_where_the_references_are():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    moved = np.where(np.arange(PIXELS) == 2, 2 * H, 0.0)
    given = keyframe(MS, [0] * PIXELS, moved=moved, next_index=2, event_threshold=0.05)
    found.take_keyframe(given)
    assert found.event_threshold == H
    found.take(packet(MS, [(-5, 2, 1, 1), (-3, 2, 1, 1)]))
    assert found.event_threshold == H
    found.take(packet(2 * MS))

    bounds = ReferenceBounds(lower=LOWER * 2.0**moved, upper=UPPER * 2.0**moved)
    assert found.event_threshold == 0.05
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_allclose(found.estimate, initial_estimate(bounds, 0.05), rtol=1e-12)


def test_a_late_change_of_threshold_is_applied_to_the_packets_since():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take(packet(2 * MS, [(-5, 2, 1, 1)]))
    found.take_keyframe(keyframe(MS, [0] * PIXELS, event_threshold=0.05))

    assert found.event_threshold == 0.05
    assert found.synchrony is Synchrony.EXACT
    expected = initial_estimate(PROBLEM.bounds, 0.05) * 2.0 ** (0.05 * np.eye(PIXELS)[2])
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-12)


def test_two_changes_of_the_threshold_while_away_are_no_restart():
    found = running()
    found.take_keyframe(keyframe(SECOND, [1] * PIXELS, moved=0.3, event_threshold=0.05))
    found.take(packet(SECOND))

    assert found.synchrony is Synchrony.EXACT
    assert found.event_threshold == 0.05
    moved = 2.0 ** np.full(PIXELS, 0.3)
    bounds = ReferenceBounds(lower=LOWER * moved, upper=UPPER * moved)
    expected = initial_estimate(bounds, 0.05) * 2.0**0.05
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-12)


def test_a_sensor_that_starts_again_gives_its_references_of_now():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    for one in packets_of(COURSE):
        found.take(one)
    now = LOWER * 3
    stamp_ns = (len(COURSE) + 1) * MS
    found.take_keyframe(keyframe(stamp_ns, [0] * PIXELS, epoch=8, lower=now, upper=now))
    found.take(packet(stamp_ns))

    assert found.synchrony is Synchrony.EXACT
    bounds = ReferenceBounds(lower=now, upper=now)
    np.testing.assert_allclose(found.estimate, initial_estimate(bounds, H), rtol=1e-12)
    with pytest.raises(MessageError, match='epoch 7, which is over'):
        found.take_keyframe(keyframe(stamp_ns, [0] * PIXELS))
    assert found.take(packet(stamp_ns + MS, [(-5, 2, 1, 1)], 0)).lost_events == 0


def test_a_sensor_without_bounds_of_its_references_leaves_them_unknown():
    found = running()
    found.take(packet(0))
    nothing, anything = np.zeros(PIXELS), np.full(PIXELS, np.inf)
    found.take_keyframe(keyframe(0, [0] * PIXELS, lower=nothing, upper=anything))

    assert found.synchrony is Synchrony.UNKNOWN
    np.testing.assert_array_equal(found.estimate, nothing)
    y = np.linspace(0.5, 0.6, PIXELS)
    found.take_anchor(Anchor(stamp_ns=0, luminosity=y))
    assert found.synchrony is Synchrony.EXACT
    np.testing.assert_allclose(found.estimate, y, rtol=H)


def test_a_number_that_goes_back_is_no_loss_but_another_sensor():
    found = running()
    for one in packets_of(COURSE):
        found.take(one)

    report = found.take(packet(9 * MS, [(-5, 2, 1, 1)], 0))

    assert report == PacketReport()
    assert found.synchrony is Synchrony.UNKNOWN
    assert found.take(packet(10 * MS, [(-5, 2, 1, 1)], 4)).lost_events == 3
    assert found.synchrony is not Synchrony.EXACT


def test_an_epoch_that_is_over_is_taken_again_only_after_several_keyframes():
    found = running()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    found.take_keyframe(keyframe(0, [0] * PIXELS, epoch=8))
    for _ in range(2):
        with pytest.raises(MessageError, match='which is over'):
            found.take_keyframe(keyframe(0, [3] * PIXELS))
    assert found.counts.tolist() == [0] * PIXELS

    found.take_keyframe(keyframe(0, [3] * PIXELS))
    assert found.counts.tolist() == [3] * PIXELS


@pytest.mark.parametrize('numbers', [{'counts': [2**31] * PIXELS}, {'moved': 900.0}])
def test_a_keyframe_beyond_all_numbers_changes_nothing(numbers):
    controller = running()
    controller.take(packet(0))
    before = controller.estimate.copy()

    with pytest.raises(MessageError, match='the luminosity is not physically possible'):
        controller.take_keyframe(keyframe(0, **{'counts': [0] * PIXELS, **numbers}))

    assert np.array_equal(controller.estimate, before)
    assert np.isfinite(controller.command).all()
