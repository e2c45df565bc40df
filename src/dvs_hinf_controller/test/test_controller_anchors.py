"""Absolute measurements in the running controller, and the pixels that they mask."""

import numpy as np
import pytest
from controller_cases import (
    LOWER,
    MS,
    PIXELS,
    PROBLEM,
    SECOND,
    UPPER,
    H,
    keyframe,
    packet,
    running,
    with_anchors,
)

from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_hinf_controller.running.reference_state import Synchrony


def test_an_anchor_waits_for_the_packet_of_its_stamp_and_counts_what_came_after():
    early, late = with_anchors(), with_anchors()
    y = (LOWER + UPPER) / 2 * 1.02
    anchor = Anchor(stamp_ns=2 * MS, luminosity=y)
    late_rows = [(2 * MS, [(-5, 1, 1, 1)], 0), (3 * MS, [(-5, 1, 1, 1)], 1)]
    for each in (early, late):
        each.take(packet(0))
    early.take_anchor(anchor)
    assert early.references.anchors.used == 0
    for row in late_rows:
        early.take(packet(*row))
        late.take(packet(*row))
    late.take_anchor(anchor)

    assert early.references.anchors.used == late.references.anchors.used == 1
    np.testing.assert_allclose(early.estimate, late.estimate, rtol=1e-12)
    assert np.any(early.estimate != running().estimate)


@pytest.mark.parametrize('stamp_ns', [-MS, 9 * SECOND])
def test_an_anchor_older_or_newer_than_what_is_kept_changes_nothing(stamp_ns):
    found = with_anchors()
    found.take(packet(0))
    before = found.estimate.copy()
    anchor = Anchor(stamp_ns=stamp_ns, luminosity=np.full(PIXELS, 9.0))
    if stamp_ns > 0:
        with pytest.raises(MessageError, match='anchor stamped'):
            found.take_anchor(anchor)
    else:
        found.take_anchor(anchor)
        assert found.references.anchors.unused == 1
    np.testing.assert_array_equal(found.estimate, before)


def test_what_waits_for_its_packet_is_bounded_and_none_of_the_far_future_blocks_it():
    found = with_anchors(anchor=0.01)
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    for far in (2_000 * MS, 10**15):
        with pytest.raises(MessageError, match='from the last events'):
            found.take_anchor(Anchor(stamp_ns=far, luminosity=np.ones(PIXELS)))
        with pytest.raises(MessageError, match='from the last events'):
            found.take_keyframe(keyframe(far, [9] * PIXELS, event_threshold=0.2))
    for k in range(1000):
        found.take_anchor(
            Anchor(stamp_ns=(k + 1) * MS // 2, luminosity=PROBLEM.set_point_luminosity)
        )
        found.take_keyframe(keyframe((k + 1) * MS // 2, [0] * PIXELS))

    found.take(packet(501 * MS))

    anchors = found.references.anchors
    assert 0 < anchors.used + anchors.unused <= 16
    assert found.event_threshold == H
    assert found.synchrony is Synchrony.EXACT


def test_an_anchor_of_another_array_is_refused():
    with pytest.raises(MessageError, match='anchor of 2 pixels, the array has 6'):
        running().take_anchor(Anchor(stamp_ns=0, luminosity=np.ones(2)))


def test_a_hot_pixel_is_masked_and_the_mean_goes_over_the_others():
    found = with_anchors(anchor=0.01)
    y = PROBLEM.set_point_luminosity
    found.take_keyframe(keyframe(0, [0] * PIXELS, lower=y, upper=y))
    for k in range(200):
        rows = [(-7, 3, 1, 1), (-5, 3, 1, 1)]
        found.take(packet(k * MS, rows, 2 * k))
        if k % 30 == 29:
            found.take_anchor(Anchor(stamp_ns=k * MS, luminosity=y))

    healthy = np.arange(PIXELS) != 3
    assert found.references.health.healthy.tolist() == healthy.tolist()
    others = with_anchors(mask=(3,), anchor=0.01)
    others.take_keyframe(keyframe(0, [0] * PIXELS, lower=y, upper=y))
    others.take(packet(0))
    np.testing.assert_array_equal(found.estimate[healthy], others.estimate[healthy])
    assert found.estimate[3] / y[3] > 10 or found.estimate[3] / y[3] < 2
    np.testing.assert_allclose(others.estimate[healthy], y[healthy], rtol=H)
