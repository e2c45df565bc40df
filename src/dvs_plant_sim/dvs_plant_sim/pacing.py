"""How long simulated time has to wait for the wall clock."""

from __future__ import annotations

from dvs_common.nanoseconds import as_seconds


class Pace:
    """Ties simulated time to the wall clock by a factor that may change on the way.

    Parameters
    ----------
    factor
        Simulated seconds per wall-clock second; 0 means as fast as possible.
    """

    def __init__(self, factor: float) -> None:
        self._factor = factor
        self._anchor: tuple[int, float] | None = None

    @property
    def is_free(self) -> bool:
        """Whether simulated time never waits."""
        return self._factor == 0

    def change(self, factor: float) -> None:
        """Run at another factor from now on.

        Parameters
        ----------
        factor
            New factor.
        """
        self._factor = factor
        self._anchor = None

    def delay_s(self, simulated_ns: int, wall_s: float) -> float:
        """Seconds until `simulated_ns` is due; 0 if it is due already.

        Parameters
        ----------
        simulated_ns
            Simulated time, ns.
        wall_s
            Reading of a monotonic clock, s.
        """
        if self._factor == 0:
            return 0.0
        if self._anchor is None:
            self._anchor = simulated_ns, wall_s
        start_ns, start_s = self._anchor
        due_s = start_s + as_seconds(simulated_ns - start_ns) / self._factor
        return max(0.0, due_s - wall_s)
