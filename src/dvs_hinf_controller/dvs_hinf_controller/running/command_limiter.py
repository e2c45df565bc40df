"""Limits of the command and of its rate, with anti-windup."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.riccati import stabilizing_solution

_KEPT_STEPS = 16
# Share of the limits that a lag as large as the luminosity is worth, times the rate at which the
# plant runs away, 1/s. A plant that is slower than this may use all.
_EFFORT = 0.5
_SLOWEST = 1.0


class CommandLimiter:
    """Bounds a command and keeps K from winding up while the bound holds.

    A model of the plant carries how far it lags behind a plant without limits:
    ``lag' = A lag + B (u_K - u)``, u_K being K's own command and u the one that is sent. K sees
    ``c'lag`` added to its measurement, so that K and ``x + lag`` are the loop without limits,
    which is stable; and ``u = sat(u_K + F lag)`` takes the lag back, F being an LQR gain that
    stabilises the plant with the less effort the faster it runs away: what has little to spare
    must not be asked for more
    (Weston and Postlethwaite, Automatica 36(9), 2000, with a coprime factor of the plant).
    Without a command at its limit nothing changes: the lag is zero to the bit.

    Parameters
    ----------
    problem
        Plant and luminosity.
    magnitude
        Largest ``|u_o|``, shape (m,), infinite where there is none.
    rate
        Largest change of ``u_o`` in a second, shape (m,), infinite where there is none.

    Raises
    ------
    ParameterError
        If no gain takes the lag back.

    Attributes
    ----------
    limited
        Number of commands that were held back by their magnitude.
    slowed
        Number of commands that were held back by their rate.
    """

    def __init__(self, problem: DesignProblem, magnitude: FloatArray, rate: FloatArray) -> None:
        model = problem.model
        self._model, self._magnitude, self._rate = model, magnitude, rate
        self._output = model.output_vector
        fastest = max(np.abs(np.linalg.eigvals(model.state_matrix)).max(), _SLOWEST)
        scale = np.where(np.isfinite(magnitude), magnitude, rate / fastest)
        weight = np.diag(np.where(np.isfinite(scale), scale, scale[np.isfinite(scale)].max()) ** 2)
        c = _effort(model.state_matrix) * model.gradients / (problem.mean_luminosity or 1.0)
        b = model.input_matrix
        riccati = stabilizing_solution(model.state_matrix, b @ weight @ b.T, c.T @ c)
        if riccati is None:
            raise ParameterError(
                'command_limit', magnitude.tolist(), 'has no anti-windup gain with these limits'
            )
        self._gain = weight @ b.T @ riccati
        self._steps: dict[float, tuple[FloatArray, FloatArray]] = {}
        self.limited = self.slowed = 0

    @classmethod
    def where_limited(
        cls, problem: DesignProblem, magnitude: FloatArray, rate: FloatArray | None
    ) -> CommandLimiter | None:
        """Limiter for a command that has a limit; None for one that has none.

        Parameters
        ----------
        problem
            Plant and luminosity.
        magnitude
            Largest ``|u_o|``, shape (m,).
        rate
            Largest change of ``u_o`` in a second, shape (m,); None for no limit.
        """
        if rate is None:
            rate = np.full(magnitude.shape, math.inf)
        if not (np.isfinite(magnitude).any() or np.isfinite(rate).any()):
            return None
        return cls(problem, magnitude, rate)

    def begin(self, resting: FloatArray) -> None:
        """Begin at the input that holds the set-point, with no lag.

        Parameters
        ----------
        resting
            That input, shape (m,).
        """
        self._lag = np.zeros(self._model.state_count)
        self.command = np.clip(resting, -self._magnitude, self._magnitude)
        self._held_back = np.zeros_like(self.command)
        self.is_limited = False

    @property
    def luminosity(self) -> FloatArray:
        """``c'lag``: how much more of luminosity a plant without limits would show.

        Shape (k,) where there are k pixel groups, else ().
        """
        return np.asarray(self._output @ self._lag)

    def advance(self, duration_s: float) -> None:
        """Let the lag grow and shrink under the command that was sent last.

        Parameters
        ----------
        duration_s
            Time for which it was held, s.
        """
        if duration_s and (self._lag.any() or self._held_back.any()):
            transition, response = self._step(duration_s)
            self._lag = transition @ self._lag + response @ self._held_back

    def take(self, wanted: FloatArray, duration_s: float, *, is_resting: bool) -> None:
        """Limit the next command.

        Parameters
        ----------
        wanted
            K's own command u_K, shape (m,).
        duration_s
            Time since the last command, s.
        is_resting
            Whether K rests, so that there is nothing to catch up with.
        """
        if is_resting:
            self._lag = np.zeros_like(self._lag)
        target = wanted + self._gain @ self._lag
        bounded = np.clip(target, -self._magnitude, self._magnitude)
        most = np.full(bounded.shape, math.inf)
        np.multiply(self._rate, duration_s, out=most, where=np.isfinite(self._rate))
        command = np.clip(bounded, self.command - most, self.command + most)
        is_bounded = bool((bounded != target).any())
        is_slowed = bool((command != bounded).any())
        self.limited += is_bounded
        self.slowed += is_slowed
        self.is_limited = is_bounded or is_slowed
        self._held_back = np.zeros_like(command) if is_resting else wanted - command
        self.command = command

    def _step(self, duration_s: float) -> tuple[FloatArray, FloatArray]:
        """``exp(A t)`` and ``int_0^t exp(A s) ds B``."""
        step = self._steps.get(duration_s)
        if step is None:
            n, m = self._model.state_count, self._model.input_count
            augmented = np.zeros((n + m, n + m))
            augmented[:n, :n] = self._model.state_matrix
            augmented[:n, n:] = self._model.input_matrix
            exponential = expm(augmented * duration_s)
            step = exponential[:n, :n], exponential[:n, n:]
            if len(self._steps) < _KEPT_STEPS:
                self._steps[duration_s] = step
        return step


def _effort(state_matrix: FloatArray) -> float:
    """Share of the limits for a lag: the faster a plant runs away, the less it has to spare."""
    fastest = float(np.linalg.eigvals(state_matrix).real.max())
    return _EFFORT / max(fastest, _EFFORT)
