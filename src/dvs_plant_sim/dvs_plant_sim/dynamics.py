"""What a plant must offer to be simulated: a state, and a way to advance it."""

from __future__ import annotations

from typing import Protocol

from dvs_common.arrays import FloatArray


class Dynamics(Protocol):
    """A plant between samples; any class with these two members is one.

    The linear `Plant` and the non-linear `Pendulum` are examples. What `advance` does must depend
    on its arguments and the state alone, so that runs can be repeated to the byte.

    Parameters
    ----------
    state
        State x in original coordinates, shape (n,).
    """

    state: FloatArray

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on by `duration_ns` with the input held at `command`.

        Parameters
        ----------
        duration_ns
            Length of the step, ns, >= 0.
        command
            u_o, shape (m,).
        """
