"""The health of a node on /diagnostics: one level, one sentence and the figures behind it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus.

    OK: all is well. WARN: it works, but needs attention. ERROR: what the node publishes is wrong
    or misses something. STALE: its input has stopped.
    """

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Trouble:
    """One thing that is not as it should be.

    Parameters
    ----------
    level
        How bad it is.
    message
        What it is.
    """

    level: Level
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """State of a node.

    Parameters
    ----------
    troubles
        What is not as it should be; none is OK.
    values
        Figures by name.
    """

    troubles: Sequence[Trouble] = ()
    values: Mapping[str, object] = field(default_factory=dict)

    @property
    def level(self) -> Level:
        """Worst level of all troubles; an input that has stopped outweighs the rest."""
        return max((trouble.level for trouble in self.troubles), default=Level.OK)

    @property
    def message(self) -> str:
        """All troubles in one sentence, the worst first."""
        ordered = sorted(self.troubles, key=lambda trouble: -trouble.level)
        return '; '.join(trouble.message for trouble in ordered) or 'ok'


class RateMeter:
    """Rate of a growing count between two readings."""

    def __init__(self) -> None:
        self._count = 0.0
        self._time_s = time.monotonic()

    def read(self, count: float) -> float:
        """Growth per wall-clock second since the last reading.

        Parameters
        ----------
        count
            Present count.
        """
        now_s = time.monotonic()
        rate = (count - self._count) / max(now_s - self._time_s, 1e-9)
        self._count, self._time_s = count, now_s
        return rate
