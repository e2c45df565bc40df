"""The lockstep handshake: sample k waits for the command stamped k."""

from __future__ import annotations

from dvs_common.wire.cdr import MessageError


class Handshake:
    """Counts samples and finds which command is the awaited one.

    Parameters
    ----------
    period_ns
        Sampling period, ns.
    last_sample
        Number of the last sample; 0 means no end.
    """

    def __init__(self, *, period_ns: int, last_sample: int) -> None:
        self._period_ns = period_ns
        self._last_sample = last_sample
        self.sample = 0
        self.stamp_ns = 0
        # Nothing has been sent: whatever command comes answers a sample of another run.
        self._answered = self._is_fresh = True
        self._waiting_turns = 0

    @property
    def is_last(self) -> bool:
        """Whether the run ends with the current sample."""
        return self._last_sample > 0 and self.sample == self._last_sample

    def accepts(self, stamp_ns: int) -> bool:
        """Whether a command with this stamp answers the current sample, for the first time.

        Before the first sample is sent none does: latched commands are of an earlier run.

        Parameters
        ----------
        stamp_ns
            Stamp of the command, ns.

        Raises
        ------
        MessageError
            If the command is from the future.
        """
        if self._is_fresh:
            return False
        if stamp_ns > self.stamp_ns:
            raise MessageError(f'command is stamped {stamp_ns} ns, awaited {self.stamp_ns} ns')
        if self._answered or stamp_ns < self.stamp_ns:
            return False
        self._answered = True
        return True

    def next(self) -> int:
        """Go on to the next sample and return its time, ns; it is answered only once `sent`."""
        self.sample += 1
        self.stamp_ns += self._period_ns
        return self.stamp_ns

    def sent(self) -> None:
        """Wait for the answer to the current sample from now on."""
        self._answered = self._is_fresh = False
        self._waiting_turns = 0

    def wait(self) -> int:
        """Let one waiting turn pass; return how many have passed in vain, 0 once answered."""
        if self._answered:
            return 0
        self._waiting_turns += 1
        return self._waiting_turns
