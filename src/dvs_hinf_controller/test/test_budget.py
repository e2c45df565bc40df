"""The budget of a running controller: its worst moment since it was last read."""

import math

import numpy as np
import pytest
from controller_cases import MS, PIXELS, PROBLEM, keyframe, packet, with_anchors

from dvs_common.wire.anchor import Anchor

WIDTH = 0.5 * math.log((PROBLEM.bounds.upper / PROBLEM.bounds.lower).max())


def read(controller):
    return controller.read_budget(0.2)


def test_the_budget_at_the_start_is_threshold_and_width():
    budget = read(with_anchors())

    assert budget.ignorance == pytest.approx(WIDTH)
    assert budget.used == pytest.approx(budget.threshold + WIDTH)
    assert budget.allowed == math.atanh(0.2)


def test_the_worst_moment_between_two_readings_is_reported():
    found = with_anchors(leak=2.0, anchor=0.01)
    y = PROBLEM.set_point_luminosity
    found.take(packet(0))
    read(found)
    found.take(packet(500 * MS))
    widest = float(found.references.intervals.half_widths.max())
    found.take_anchor(Anchor(stamp_ns=500 * MS, luminosity=y))
    narrow = float(found.references.intervals.half_widths.max())

    assert narrow < widest
    assert read(found).ignorance == widest
    # From now on it is another moment.
    assert read(found).ignorance == narrow


def test_lost_events_end_the_certificate_until_a_keyframe_comes():
    found = with_anchors()
    found.take_keyframe(keyframe(0, [0] * PIXELS))
    found.take(packet(0))
    read(found)
    found.take(packet(MS, [(-5, 2, 1, 1)], 4))
    lost = read(found)

    assert lost.used > lost.allowed
    assert str(lost).startswith('not certified')
    found.take_keyframe(keyframe(MS, [0, 0, 5, 0, 0, 0], next_index=5))
    read(found)
    assert read(found).is_certified


def test_a_masked_pixel_is_not_counted():
    masked = with_anchors(mask=(0,))
    known = masked.references.intervals
    known.half_widths[:] = 0.1
    known.half_widths[0] = np.inf

    assert known.width == 0.1


def test_a_pixel_masked_since_the_last_reading_is_named():
    found = with_anchors(mask=(4,), anchor=0.01)
    health = found.references.health
    bad = np.arange(PIXELS) == 2
    for _ in range(4):
        health.note(~bad, bad)
    while not health.healthy[2]:
        health.note(np.ones(PIXELS, bool), np.zeros(PIXELS, bool))

    assert read(found).masked_pixels == (2, 4)
    # From now on it is another moment.
    assert read(found).masked_pixels == (4,)
