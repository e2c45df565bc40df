"""The loop of the nodes from sample to sample: held commands, latency, and all that acts on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_common.scenario.model import PlantModel
from dvs_hinf_controller.analysis.flows import Step, trapezoidal_weights
from dvs_hinf_controller.analysis.plant_rates import plant_rate
from dvs_hinf_controller.analysis.tail_bounds import (
    Bound,
    lyapunov_bound,
    modal_bound,
)
from dvs_hinf_controller.controller import LinearController

_FASTEST_DECAY = 100.0
CHORD_SHARE = 0.45
_DECAYED = 15.0
_PHASES_PER_RADIAN = 6.0
_MOST_PHASES = 8
_NO_TIME = 1e-12


class SampledFlow:
    """``xi_(k+1) = a xi_k``, a sample every `period`.

    Parameters
    ----------
    a
        Stable, shape (size, size).
    period
        s.
    """

    def __init__(self, a: FloatArray, period: float) -> None:
        self._a, self._period = a, period
        slope = (a - np.eye(len(a))) / period
        self.curve = slope @ slope
        self.per_second = 1 / period
        self._multipliers, self._vectors = np.linalg.eig(a)
        sizes = np.maximum(np.abs(self._multipliers), math.exp(-_FASTEST_DECAY))
        self._rates = -np.log(sizes) / period
        self._powers = [a]

    def bounds(self, outputs: FloatArray, states: int) -> list[Bound]:
        """Modal bound where the modes are well conditioned, and one by a Lyapunov function.

        Parameters
        ----------
        outputs
            Shape (P, p, size).
        states
            How many of the first outputs are states.
        """
        found = modal_bound(self._vectors, self._rates, outputs, states)
        rate = 0.5 * float(self._rates.min())
        shifted = self._a * math.exp(rate * self._period)
        confirmed = lyapunov_bound(
            outputs,
            states,
            rate,
            solve=lambda q: scipy.linalg.solve_discrete_lyapunov(shifted.T, q),
            decrease=lambda p: p - shifted.T @ p @ shifted,
        )
        return found if confirmed is None else [*found, confirmed]

    def step(self, allowed_s: float) -> Step:
        """Longest step of a power of two samples, at most a tenth of the slowest time constant.

        Parameters
        ----------
        allowed_s
            s.
        """
        longest = min(allowed_s, 0.1 / float(self._rates.min()))
        level = max(0, math.floor(math.log2(max(longest / self._period, 1.0))))
        while len(self._powers) <= level:
            self._powers.append(self._powers[-1] @ self._powers[-1])
        return Step(
            length=self._period * 2.0**level, transition=self._powers[level], exact=level == 0
        )

    def weights(self, times: FloatArray) -> FloatArray:
        """Number of samples that each node stands for.

        Parameters
        ----------
        times
            Ascending, shape (N,), s.
        """
        weights = trapezoidal_weights(times) / self._period
        weights[[0, -1]] += 0.5
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """When commands are computed and when they act.

    Parameters
    ----------
    period
        Sampling period T, s.
    latency
        Time from a sample to the instant at which the plant applies its command, s.
    """

    period: float
    latency: float

    @property
    def whole(self) -> int:
        """Whole periods in the latency."""
        return math.floor(self.latency / self.period + 1e-9)

    @property
    def rest(self) -> float:
        """What is left of the latency, s."""
        rest = self.latency - self.whole * self.period
        return rest if rest > _NO_TIME else 0.0

    @property
    def remembered(self) -> int:
        """Number of earlier commands that belong to the state, at least 1."""
        return max(1, self.whole + (self.rest > 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandResponse:
    """What a change of one command does.

    Parameters
    ----------
    outputs
        Within the period of its sample, shape (P, p).
    state
        The lifted state one period later, shape (size,).
    """

    outputs: FloatArray
    state: FloatArray


class LiftedLoop:
    """State (x, xc, earlier commands) at the samples; everything else is an output of it.

    The plant holds each command for a period; K is advanced exactly with what it sees at all times
    (docs/promise.md).

    Parameters
    ----------
    model
        Plant.
    controller
        K.
    timing
        Period and latency.
    weights
        W of the error ``||W x||``, shape (n,); None for all 1.
    """

    def __init__(
        self,
        model: PlantModel,
        controller: LinearController,
        timing: Timing,
        *,
        weights: FloatArray | None = None,
    ) -> None:
        self.model, self.controller, self.timing = model, controller, timing
        self.weights = weights
        self._held = model.state_count + controller.order
        self._size = self._held + model.input_count * timing.remembered
        self._flow = self._within_a_period()
        self.phase_spacing = 0.0
        self.outputs, end = self._walk(np.eye(self._held, self._size), self._command)
        self.matrix = self._matrix(end)

    @property
    def is_stable(self) -> bool:
        """Whether the loop without any disturbance is stable."""
        return bool(
            np.isfinite(self.matrix).all() and np.max(np.abs(np.linalg.eigvals(self.matrix))) < 1
        )

    def after(self, durations: FloatArray, start: FloatArray) -> FloatArray:
        """(x, xc) after some of a period with no command, shape (S, n + k).

        Parameters
        ----------
        durations
            Shape (S,), s, ascending.
        start
            (x, xc), shape (n + k,).
        """
        flow = self._flow[: self._held, : self._held]
        path, at, last = [], start, 0.0
        for duration in durations:
            if duration > last:
                at = scipy.linalg.expm(flow * (duration - last)) @ at
                last = float(duration)
            path.append(at)
        return np.array(path)

    def lifted(self, states: FloatArray) -> FloatArray:
        """States of the lifted loop with no earlier command, shape (size, S).

        Parameters
        ----------
        states
            (x, xc), shape (S, n + k).
        """
        columns = np.zeros((self._size, len(states)))
        columns[: self._held] = states.T
        return columns

    def at_once(self, states: FloatArray) -> FloatArray:
        """Outputs of (x, xc) within its period, before any command answers, shape (S, p).

        Parameters
        ----------
        states
            Shape (S, n + k).
        """
        silent = np.zeros((self.model.input_count, len(states)))
        return self._seen(np.vstack([states.T, silent]), silent, silent).T

    def command_response(self, command: FloatArray) -> CommandResponse:
        """What an extra command at one sample does.

        Parameters
        ----------
        command
            Shape (m,).
        """
        column, none = command[:, None], np.zeros((command.size, 1))
        seen, end = self._walk(np.zeros((self._held, 1)), lambda age: none if age else column)
        state = np.zeros(self._size)
        state[: self._held] = end[:, 0]
        state[self._held : self._held + command.size] = command
        return CommandResponse(outputs=seen[:, :, 0], state=state)

    def interval_nodes(self, rtol: float) -> FloatArray:
        """Instants within a period, dense where a mode that is still alive moves, s.

        Parameters
        ----------
        rtol
            Relative size of what the chords between them may miss.
        """
        modes = np.linalg.eigvals(self._flow[: self._held, : self._held])
        nodes, period = [0.0], self.timing.period
        angle = math.sqrt(CHORD_SHARE * 12 * rtol)
        while nodes[-1] < period:
            alive = np.abs(modes[-modes.real * nodes[-1] < _DECAYED])
            step = angle / max(float(alive.max(initial=0.0)), angle / period)
            nodes.append(min(nodes[-1] + step, period))
        return np.array(nodes)

    @property
    def interval_curve(self) -> FloatArray:
        """Second derivative within a period of (x, xc) by (x, xc)."""
        flow = self._flow[: self._held, : self._held]
        return np.asarray(flow @ flow)

    def _within_a_period(self) -> FloatArray:
        """Generator of (x, xc, applied command)."""
        model, k = self.model, self.controller
        n, held = model.state_count, self._held
        flow = np.zeros((held + model.input_count,) * 2)
        flow[:n, :n], flow[:n, held:] = model.state_matrix, model.input_matrix
        flow[n:held, :n] = k.input_matrix @ model.gradients
        flow[n:held, n:held] = k.state_matrix
        return flow

    def _command(self, age: int) -> FloatArray:
        """The command of `age` samples ago, by the state, shape (m, size)."""
        n, m = self.model.state_count, self.model.input_count
        row = np.zeros((m, self._size))
        if age:
            start = self._held + m * (age - 1)
            row[:, start : start + m] = np.eye(m)
        else:
            row[:, n : self._held] = self.controller.output_matrix
            row[:, :n] = self.controller.feedthrough_matrix @ self.model.gradients
        return row

    def _walk(
        self, current: FloatArray, command: Callable[[int], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Outputs at all phases of a period, and (x, xc) at its end."""
        timing = self.timing
        pieces = [(timing.period - timing.rest, timing.whole)]
        if timing.rest > 0:
            pieces.insert(0, (timing.rest, timing.whole + 1))
        newest, change = command(0), command(0) - command(1)
        rows = []
        for length, age in pieces:
            state = np.vstack([current, command(age)])
            count = math.ceil(_PHASES_PER_RADIAN * length * plant_rate(self.model))
            count = min(max(count, 2), _MOST_PHASES)
            step = scipy.linalg.expm(self._flow * (length / count))
            self.phase_spacing = max(self.phase_spacing, length / count)
            for _ in range(count):
                rows.append(self._seen(state, newest, change))
                state = step @ state
            rows.append(self._seen(state, newest, change))
            current = state[: self._held]
        return np.array(rows), current

    def _seen(self, state: FloatArray, newest: FloatArray, change: FloatArray) -> FloatArray:
        """W x, W x'', c'x, c'x', c'x'', the newest command and its last change: rows by columns.

        x and x'' follow where there are weights.
        """
        model = self.model
        a, b, c = model.state_matrix, model.input_matrix, model.output_vector
        x, u = state[: model.state_count], state[self._held :]
        slope = a @ x + b @ u
        curve = a @ slope
        rest = [c @ x, c @ slope, c @ curve, newest, change]
        if self.weights is None:
            return np.vstack([x, curve, *rest])
        w = self.weights[:, None]
        return np.vstack([w * x, w * curve, *rest, x, curve])

    def _matrix(self, end: FloatArray) -> FloatArray:
        m, held = self.model.input_count, self._held
        matrix = np.zeros((self._size, self._size))
        matrix[:held] = end
        matrix[held : held + m] = self._command(0)
        for age in range(1, self.timing.remembered):
            matrix[held + m * age : held + m * (age + 1)] = self._command(age)
        return matrix
