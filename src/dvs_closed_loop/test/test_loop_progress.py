"""The progress line of a loop, on something that says it is a terminal."""

import io
import sys
from types import SimpleNamespace

import numpy as np

from dvs_closed_loop.running.loop_progress import LoopProgress
from dvs_common.wire import topics
from dvs_common.wire.messages import Vector, pack_command


class Screen(io.StringIO):
    def isatty(self):
        return True


def received(seconds):
    """What a recorder has after commands at these times."""
    commands = [
        pack_command(Vector(stamp_ns=round(s * 1e9), names=('u1',), values=np.zeros(1)))
        for s in seconds
    ]
    return SimpleNamespace(messages={topics.COMMAND: commands}, wall_seconds=2.0, event_count=30)


def a_screen(monkeypatch):
    # Not as a fixture: pytest gives each phase of a test a standard error of its own.
    screen = Screen()
    monkeypatch.setattr(sys, 'stderr', screen)
    return screen


def test_it_waits_and_then_counts_simulated_time(monkeypatch):
    screen = a_screen(monkeypatch)
    progress = LoopProgress(6.0)
    progress.waits_for('plant_sim to answer')
    progress.update(received([10.0]))
    assert 'waiting for plant_sim to answer' in screen.getvalue()
    assert 'simulated time' not in screen.getvalue()

    progress.update(received([10.0, 11.5]))
    progress.close()

    assert '25% |' in screen.getvalue()
    assert '1.50/6.00 s, 1 cycles/s, 15 events/s, 0.75 x real time' in screen.getvalue()


def test_a_run_may_be_longer_than_planned(monkeypatch):
    screen = a_screen(monkeypatch)
    progress = LoopProgress(6.0)
    progress.update(received([0.0, 5.0]))
    progress.update(received([0.0, 6.8]))
    progress.close()

    assert '6.80/6.80 s' in screen.getvalue()


def test_a_run_without_an_end_has_no_share(monkeypatch):
    screen = a_screen(monkeypatch)
    progress = LoopProgress(0.0)
    progress.update(received([0.0, 5.0]))
    progress.close()

    assert 'simulated time 5.00 s, 1 cycles/s' in screen.getvalue()
    assert '%' not in screen.getvalue()
