"""A simulator of fixed steps as a plant that takes durations of any length."""

from __future__ import annotations

from collections.abc import Callable

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError


class FixedStep:
    """Advances by whole steps; what is left of a duration is carried over to the next.

    In realtime mode a command acts from its arrival on, so that durations are of any length; a
    physics engine has a step that it was tuned for. The state is late by less than a step.

    Parameters
    ----------
    step
        State and held command, shapes (n,) and (m,), to the state one step later.
    step_ns
        Length of a step, ns, > 0.
    initial_state
        x0, shape (n,).

    Raises
    ------
    ParameterError
        If `step_ns` is not positive.
    """

    def __init__(
        self,
        step: Callable[[FloatArray, FloatArray], FloatArray],
        *,
        step_ns: int,
        initial_state: FloatArray,
    ) -> None:
        if step_ns <= 0:
            raise ParameterError('step_ns', step_ns, 'must be > 0')
        self.state = initial_state
        self._step = step
        self._step_ns = step_ns
        self._left_ns = 0

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on by the whole steps of what has passed; see `Dynamics.advance`.

        Parameters
        ----------
        duration_ns
            Length, ns, >= 0.
        command
            u_o, shape (m,).
        """
        steps, self._left_ns = divmod(self._left_ns + duration_ns, self._step_ns)
        for _ in range(steps):
            self.state = self._step(self.state, command)
