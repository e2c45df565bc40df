"""Wakes an executor when the machine's wall clock is set back.

ROS as wheels is built for a C++ library that waits for instants of the wall clock, also where it
is asked for monotonic ones: set back by an hour, an executor would wait for an hour.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable

# A step beyond this is longer than what a wait may be late without notice.
_STEP_S = 0.05
_PERIOD_S = 0.1


class ClockWatch:
    """Looks at the clock ten times a second, on a thread of its own that waits by intervals.

    Parameters
    ----------
    wake
        Ends a wait of the main thread; called on the other one.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self.was_set_back = False
        self._wake = wake
        self._ended, self._end = os.pipe()
        self._thread = threading.Thread(target=self._watch, name='clock watch', daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        before_s = _ahead_s()
        while not select.select([self._ended], [], [], _PERIOD_S)[0]:
            ahead_s = _ahead_s()
            if ahead_s < before_s - _STEP_S:
                self.was_set_back = True
                self._wake()
            before_s = ahead_s

    def close(self) -> None:
        """End the thread."""
        os.write(self._end, b'.')
        self._thread.join()
        os.close(self._end)
        os.close(self._ended)


def _ahead_s() -> float:
    """By how much the wall clock is ahead of the monotonic one, s."""
    return time.time() - time.monotonic()
