"""Packets that a controller gets at its start, of which the last one alone waits for an answer."""

from __future__ import annotations

import math

# Packets of a backlog follow each other faster; a partner that waits for a command is silent.
_QUIET_S = 0.005
# A sensor that waits for no command is never silent.
_LONGEST_S = 1.0


class Backlog:
    """Finds when what was sent before the start has been taken.

    The middleware delivers packets of the past to a late controller of a lockstep loop. Answers to
    them would carry stamps that a plant which has started again awaits as its own.

    Parameters
    ----------
    start_ns
        When the controller started, ns of the machine's clock.
    """

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._first_s = self._last_s = math.inf

    def is_of_now(self, published_ns: int | None, now_ns: int) -> bool:
        """Whether a packet is known to be none of the past.

        The clock of another machine may be ahead: what it publishes seems to come from the future,
        and then nothing is known.

        Parameters
        ----------
        published_ns
            When it was published, by the clock of its publisher; None where that is not known.
        now_ns
            The time by the clock of this machine.
        """
        return published_ns is not None and self._start_ns < published_ns <= now_ns

    def add(self, now_s: float) -> None:
        """Note a packet.

        Parameters
        ----------
        now_s
            When it came, s.
        """
        self._first_s, self._last_s = min(self._first_s, now_s), now_s

    def is_over(self, now_s: float) -> bool:
        """Whether the last packet is one that waits for its answer; not before the first one.

        Parameters
        ----------
        now_s
            The time, s.
        """
        return now_s - self._last_s >= _QUIET_S or now_s - self._first_s >= _LONGEST_S
