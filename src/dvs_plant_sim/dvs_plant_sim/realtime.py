"""The plant on the wall clock: commands act from the instant at which they arrive."""

from __future__ import annotations

from collections import deque

from dvs_common.arrays import FloatArray
from dvs_plant_sim.dynamics import Dynamics


class RealtimePlant:
    """Advances a plant to wall-clock instants under the commands received so far.

    The plant rests at its initial state until the first command: an unstable plant can't wait for
    a controller that is still starting.

    Parameters
    ----------
    plant
        Plant to move.
    """

    def __init__(self, plant: Dynamics) -> None:
        self._plant = plant
        self._time_ns = 0
        self._command: FloatArray | None = None
        self._arrivals: deque[tuple[int, FloatArray]] = deque()
        self.last_arrival_ns: int | None = None

    @property
    def released(self) -> bool:
        """Whether a first command has come."""
        return self.last_arrival_ns is not None

    @property
    def state(self) -> FloatArray:
        """Plant state x, shape (n,)."""
        return self._plant.state

    def receive(self, arrival_ns: int, command: FloatArray) -> None:
        """Let `command` act from `arrival_ns` on.

        Parameters
        ----------
        arrival_ns
            Wall-clock time of the arrival, ns.
        command
            u_o, shape (m,).
        """
        self._arrivals.append((arrival_ns, command))
        self.last_arrival_ns = arrival_ns

    def advance_to(self, time_ns: int) -> None:
        """Move on to `time_ns`, switching the input at every arrival on the way.

        Parameters
        ----------
        time_ns
            Wall-clock time, ns; not before the previous one.
        """
        while self._arrivals and self._arrivals[0][0] <= time_ns:
            arrival_ns, command = self._arrivals.popleft()
            self._hold_until(arrival_ns)
            self._command = command
        self._hold_until(time_ns)

    def _hold_until(self, time_ns: int) -> None:
        if self._command is not None and time_ns > self._time_ns:
            self._plant.advance(time_ns - self._time_ns, self._command)
        self._time_ns = max(self._time_ns, time_ns)
