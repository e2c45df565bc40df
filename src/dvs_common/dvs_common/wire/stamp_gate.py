"""Stamps of a stream: one that does not fit is an outlier, several that agree are a step."""

from __future__ import annotations

from enum import Enum

from dvs_common.nanoseconds import NANOSECONDS

# So many samples that follow each other prove that the clock has stepped, or so many repetitions
# of one: a lockstep partner sends a sample without an answer again.
_FOLLOWING = 5
_REPEATED = 3


class Passage(Enum):
    """What the stamp of a message means."""

    FIRST = 'the first one'
    NEXT = 'later than the last one'
    REPEATED = 'the last one again'
    REFUSED = 'an outlier'
    STEPPED = 'a step of the clock'


class StampGate:
    """Lets stamps pass that follow the last one, and a step of the clock once it is certain.

    Parameters
    ----------
    reach_ns
        A stamp farther ahead of the last one than this is an outlier, like one that goes back.
    """

    def __init__(self, reach_ns: int = NANOSECONDS) -> None:
        self._reach_ns = reach_ns
        self.refused = 0
        self.restart(None)

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last message that passed, ns."""
        return self._last_ns

    def restart(self, stamp_ns: int | None) -> None:
        """Go on from another stamp.

        Parameters
        ----------
        stamp_ns
            Last stamp, ns; None if the next one is the first.
        """
        self._last_ns = stamp_ns
        self._outlier_ns: int | None = None
        self._following = self._repeated = 0

    def follows(self, stamp_ns: int) -> bool:
        """Whether a stamp is not before the last one and within reach of it.

        Parameters
        ----------
        stamp_ns
            Stamp, ns.
        """
        return self._last_ns is None or 0 <= stamp_ns - self._last_ns <= self._reach_ns

    def take(self, stamp_ns: int) -> Passage:
        """Judge the stamp of a message.

        Parameters
        ----------
        stamp_ns
            Stamp, ns.
        """
        last_ns = self._last_ns
        if self.follows(stamp_ns):
            if stamp_ns != last_ns:
                self.restart(stamp_ns)
                return Passage.FIRST if last_ns is None else Passage.NEXT
            return Passage.REPEATED
        if self._is_certain(stamp_ns):
            self.restart(stamp_ns)
            return Passage.STEPPED
        self.refused += 1
        return Passage.REFUSED

    def _is_certain(self, stamp_ns: int) -> bool:
        outlier_ns, self._outlier_ns = self._outlier_ns, stamp_ns
        if outlier_ns == stamp_ns:
            self._repeated += 1
        elif outlier_ns is not None and 0 < stamp_ns - outlier_ns <= self._reach_ns:
            self._following += 1
            self._repeated = 1
        else:
            self._following = self._repeated = 1
        return self._following >= _FOLLOWING or self._repeated >= _REPEATED
