"""The plant between samples: exact propagation under an input that is held constant."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from dvs_common.arrays import FloatArray, finite_array
from dvs_common.errors import ParameterError
from dvs_common.nanoseconds import as_seconds
from dvs_common.scenario.model import PlantModel


class Plant:
    """State of ``xdot = A x + B u`` at integer nanoseconds, advanced without discretisation error.

    One matrix exponential of ``[[A, B], [0, 0]]`` a step length gives both the transition and the
    input matrix (Van Loan, IEEE TAC 23(3), 1978); the sampling period's is computed once.

    Parameters
    ----------
    model
        A, B, c.
    initial_state
        x at time 0, shape (n,).
    period_ns
        Usual step, ns.

    Raises
    ------
    ParameterError
        If the initial state has not n finite entries or the period is not positive.
    """

    def __init__(self, model: PlantModel, *, initial_state: FloatArray, period_ns: int) -> None:
        state = finite_array('initial_state', initial_state, ndim=1)
        if state.size != model.state_count:
            raise ParameterError(
                'initial_state', state.tolist(), f'must have {model.state_count} entries'
            )
        if period_ns <= 0:
            raise ParameterError('sampling_period', as_seconds(period_ns), 'must be > 0')
        self._model = model
        self.state = state
        self.period_ns = period_ns
        # exp(A T) and the input matrix of a period.
        self.period_step = held_input_step(model, period_ns)

    def advance(self, duration_ns: int, command: FloatArray) -> None:
        """Move on by `duration_ns` with the input held at `command`.

        Parameters
        ----------
        duration_ns
            Length of the step, ns, >= 0.
        command
            u_o, shape (m,).
        """
        if duration_ns == 0:
            return
        if duration_ns == self.period_ns:
            transition, gain = self.period_step
        else:
            transition, gain = held_input_step(self._model, duration_ns)
        self.state = transition @ self.state + gain @ command


def held_input_step(model: PlantModel, duration_ns: int) -> tuple[FloatArray, FloatArray]:
    """``exp(A t)`` and ``int_0^t exp(A s) B ds``, shapes (n, n) and (n, m).

    Parameters
    ----------
    model
        A and B.
    duration_ns
        t, ns, >= 0.
    """
    n, m = model.state_count, model.input_count
    generator = np.zeros((n + m, n + m))
    generator[:n, :n] = model.state_matrix
    generator[:n, n:] = model.input_matrix
    step = expm(generator * as_seconds(duration_ns))
    return step[:n, :n].copy(), step[:n, n:].copy()
