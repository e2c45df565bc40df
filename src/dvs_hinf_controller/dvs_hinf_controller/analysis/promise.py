"""The threshold up to which the loop that runs holds its tolerance, whatever acts on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, Timing
from dvs_hinf_controller.analysis.peak_gain import ChannelGains
from dvs_hinf_controller.analysis.sampled_gains import Gains, SampledGains
from dvs_hinf_controller.analysis.static_gains import StaticGains
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.operation import Operation
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector_means import Sectors

_ROUNDS = 30
# Derivatives between two phases of a period, relative to those at them.
_BETWEEN_PHASES = 1.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """What a loop stays within for ever, in the limit.

    Parameters
    ----------
    error
        Bound of ``||W (x - x_d)||``; infinite where the small-gain condition fails.
    output
        Bound of ``|c'(x - x_d)|``, the largest of all pixel groups.
    commands
        Bound of every ``|u_o|``, feed-forward included, shape (m,).
    log_rate
        Bound of ``|d ln y_i / dt|`` of every pixel, 1/s.
    """

    error: float
    output: float
    commands: FloatArray
    log_rate: float

    @classmethod
    def nothing(cls, problem: DesignProblem) -> Held:
        """No bound at all.

        Parameters
        ----------
        problem
            What is asked.
        """
        return cls(
            error=math.inf,
            output=math.inf,
            commands=np.full(problem.model.input_count, math.inf),
            log_rate=math.inf,
        )

    def excess(self, problem: DesignProblem) -> float:
        """Error or output over its tolerance, whichever is larger; at most 1 where both hold.

        Parameters
        ----------
        problem
            What is asked.
        """
        return max(self.error / problem.tolerance, self.output / problem.output_tolerance)


class Promise:
    """Bounds of one loop as functions of the sector of its pixels.

    Every disturbance is a channel with a bound that is affine in the bounds of the loop's own
    signals: the estimation error ``|w| <= delta (|c'x| + |D|)``, entrywise errors of A and B, a
    command that acts early or late, what the camera interpolates. With the peak gains of all
    channels in a nonnegative matrix K their bounds are ``z = K z + k0``, which has a solution if
    the spectral radius of K is below one (docs/promise.md).

    Parameters
    ----------
    problem
        Plant, pixels and tolerance.
    controller
        K.
    operation
        How the loop runs and what acts on it.
    drift
        Constant addition to xdot, shape (n,), as of a set-point that the plant does not hold by
        the feed-forward; None for none.
    rtol
        Relative width that is aimed at in the peak gains.
    """

    def __init__(
        self,
        problem: DesignProblem,
        controller: LinearController,
        operation: Operation,
        *,
        drift: FloatArray | None = None,
        rtol: float = 3e-4,
    ) -> None:
        self._drift = drift
        self._problem, self._operation = problem, operation
        model = problem.model
        timing = Timing(period=operation.sampling_period, latency=operation.latency)
        loop = LiftedLoop(model, controller, timing, weights=problem.error_weights)
        self.is_stable = loop.is_stable
        self._kinks = timing.rest > 0 or operation.latency_jitter > 0
        self._phase_spacing = loop.phase_spacing
        if not self.is_stable:
            return
        self._gains = gains = SampledGains(loop, rtol=rtol)
        self._measurements = [gains.of_measurement(j) for j in range(model.group_count)]
        self._static = StaticGains(model, controller, problem.error_weights)
        self._drives, self._pulses, self._inputs, self._loads = [], [], [], []
        if operation.model_uncertainty > 0:
            self._drives = [gains.of_drive(row) for row in np.eye(model.state_count)]
        if np.any(operation.disturbance_bound):
            self._inputs = [gains.of_drive(column) for column in model.input_matrix.T]
        if np.any(operation.constant_load):
            self._loads = [gains.of_drive(column) for column in model.input_matrix.T]
        if operation.latency_jitter > 0:
            self._pulses = [
                gains.of_pulse(column, operation.latency_jitter) for column in model.input_matrix.T
            ]

    def held(self, sectors: Sectors, *, start: FloatArray | None = None) -> Held:
        """Bounds that hold for estimates in the given sectors.

        Parameters
        ----------
        sectors
            delta_i, bound of ``|z_i - y_i| / y_i`` of every pixel.
        start
            ``x - x_d`` at the start, shape (n,), for bounds that hold from then on; None for
            those that hold in the limit.
        """
        problem = self._problem
        nothing = Held.nothing(problem)
        if not self.is_stable or not all(np.isfinite(g.output).all() for g in self._measurements):
            return nothing
        unknown = self._operation.output_disturbance
        line = self._operation.linearisation
        error = line.slope_error
        means = problem.pixels.sector_means(sectors, slope_error=error, unknown=unknown)
        bend, outer = np.zeros(problem.model.group_count), self._outer(start)
        drives = self._drives_by_themselves(start)
        for _ in range(_ROUNDS):
            solved = self._solve(means.constant + bend, means.share, outer, drives)
            if solved is None:
                return nothing
            light = problem.pixels.least - unknown - (1 + error) * solved.output
            if np.any(light <= 0) or np.any(solved.output > line.luminosity_reach):
                return nothing
            rates = line.steepness * (self._rates(solved) + self._shown(drives))
            grown = self._bend(solved, rates, unknown) * (1 + means.largest)
            if np.all(grown <= bend * (1 + 1e-6)):
                break
            bend = grown * (1 + 1e-4)
        else:
            return nothing
        return Held(
            error=solved.error,
            output=float(solved.output.max()),
            commands=solved.commands + np.abs(problem.equilibrium.feedforward),
            log_rate=float(np.max(rates / light)),
        )

    def _solve(
        self, constant: FloatArray, share: FloatArray, outer: Gains, drives: FloatArray
    ) -> Gains | None:
        """Bounds of the signals for ``|w| <= constant + share |c'x|``; None if there are none."""
        channels = [*self._measurements, *self._drives, *self._pulses]
        matrix = np.array([self._answer(gains, share) for gains in channels]).T
        late = self._late(share) * self._shown(drives)
        offset = self._answer(outer, share) + self._offset(constant + late)
        if not (np.isfinite(matrix).all() and np.isfinite(offset).all()):
            return None
        if np.max(np.abs(np.linalg.eigvals(matrix))) >= 1:
            return None
        sizes = np.linalg.solve(np.eye(len(matrix)) - matrix, offset)
        return _combined([*channels, outer], [*sizes.tolist(), 1.0])

    def _outer(self, start: FloatArray | None) -> Gains:
        """What the disturbances of inputs and outputs do, together, and the start.

        What is constant counts by its static gain in the limit.
        """
        channels, sizes = [*self._measurements], [0.0] * len(self._measurements)
        if self._inputs:
            channels = [*channels, *self._inputs]
            sizes = [*sizes, *self._disturbance.tolist()]
        operation = self._operation
        loads = operation.constant_load.tolist() if self._loads else []
        if start is not None:
            channels = [*channels, self._gains.free(start), *self._loads]
            unknown = [operation.output_disturbance] * len(self._measurements)
            sizes = [*unknown, *sizes[len(unknown) :], 1.0, *loads]
            if self._drift is not None:
                channels, sizes = [*channels, self._gains.of_drive(self._drift)], [*sizes, 1.0]
        else:
            settled = map(self._static.of_load, self._problem.model.input_matrix.T, loads)
            channels = [*channels, *settled, self._static.of_measurement()]
            sizes = [*sizes, *[1.0] * len(loads), operation.output_disturbance]
            if self._drift is not None:
                channels, sizes = [*channels, self._static.of_drive(self._drift)], [*sizes, 1.0]
        return _combined(channels, sizes)

    def _answer(self, signals: Gains, share: FloatArray) -> FloatArray:
        """Sizes of all channels that signals of these bounds bring about, but for constants."""
        problem, operation = self._problem, self._operation
        model, period = problem.model, operation.sampling_period
        measured = share * signals.output + self._late(share) * self._rates(signals)
        if operation.interpolates:
            measured = measured + period**2 / 8 * signals.output_curve
            if self._kinks:
                slopes = np.abs(model.output_vector @ model.input_matrix)
                measured = measured + period / 4 * (slopes @ signals.changes)
        errors = self._model_errors(signals.states, signals.commands)
        return self._channels(measured + self._unseen(errors), errors, signals.changes)

    def _offset(self, constant: FloatArray) -> FloatArray:
        """Sizes that the channels have by themselves: luminosity, set-point, disturbances."""
        equilibrium, model = self._problem.equilibrium, self._problem.model
        errors = self._model_errors(np.abs(equilibrium.state), np.abs(equilibrium.feedforward))
        disturbance = np.zeros(model.state_count)
        if self._inputs:
            disturbance = np.abs(model.input_matrix) @ self._disturbance
        measured = constant + self._unseen(errors + disturbance)
        return self._channels(measured, errors, np.zeros(model.input_count))

    def _drives_by_themselves(self, start: FloatArray | None) -> FloatArray:
        """Bound of what disturbances add to xdot, shape (n,); constants only after a start."""
        held, model = self._problem.equilibrium, self._problem.model
        drives = self._model_errors(np.abs(held.state), np.abs(held.feedforward))
        if self._inputs:
            drives = drives + np.abs(model.input_matrix) @ self._disturbance
        if start is not None and self._loads:
            drives = drives + np.abs(model.input_matrix) @ self._operation.constant_load
        if start is not None and self._drift is not None:
            drives = drives + np.abs(self._drift)
        return drives

    def _shown(self, drives: FloatArray) -> FloatArray:
        """What a drive adds to ``|c'xdot|`` at once, shape (k,)."""
        return np.atleast_1d(np.abs(self._problem.model.output_vector) @ drives)

    def _rates(self, signals: Gains) -> FloatArray:
        """Bound of ``|c'xdot|``, drives by themselves left out, shape (k,)."""
        between = _BETWEEN_PHASES * self._phase_spacing / 2 * signals.output_curve
        errors = self._model_errors(signals.states, signals.commands)
        if self._pulses:
            errors = errors + np.abs(self._problem.model.input_matrix) @ signals.changes
        return np.asarray(signals.output_rate + between + self._shown(errors))

    def _late(self, share: FloatArray) -> FloatArray:
        """What an estimate that is late misses, by the rate of ``c'x``, shape (k,)."""
        operation = self._operation
        steepness = operation.linearisation.steepness
        return np.asarray(operation.sensor.latency * steepness * (1 + share))

    def _channels(
        self, measured: FloatArray, errors: FloatArray, changes: FloatArray
    ) -> FloatArray:
        parts = [measured]
        if self._drives:
            parts.append(errors)
        if self._pulses:
            parts.append(changes)
        return np.concatenate(parts)

    @property
    def _disturbance(self) -> FloatArray:
        m = self._problem.model.input_count
        return np.broadcast_to(self._operation.disturbance_bound, (m,))

    def _model_errors(self, states: FloatArray, commands: FloatArray) -> FloatArray:
        """Bound of ``|dA x + dB u|``, shape (n,)."""
        model, uncertainty = self._problem.model, self._operation.model_uncertainty
        if not np.any(uncertainty):
            return np.zeros(model.state_count)
        moved = _through(model.state_matrix, states) + _through(model.input_matrix, commands)
        return np.asarray(uncertainty * moved)

    def _unseen(self, drives: FloatArray) -> FloatArray:
        """What a drive that jumps within a period hides from a camera that interpolates."""
        if not self._operation.interpolates:
            return np.zeros(1)
        c, period = self._problem.model.output_vector, self._operation.sampling_period
        curves = np.abs(c @ self._problem.model.state_matrix)
        return np.atleast_1d((period / 2 * np.abs(c) + period**2 / 8 * curves) @ drives)

    def _bend(self, signals: Gains, rates: FloatArray, unknown: float) -> FloatArray:
        """How far a straight line in log y bends away from one in y, over a period, on average."""
        problem = self._problem
        if not self._operation.interpolates:
            return np.zeros(problem.model.group_count)
        operation = self._operation
        change = (1 + operation.linearisation.slope_error) * signals.output
        moved = operation.sampling_period * rates
        return problem.pixels.bend(moved, change, unknown) / 8


class Continuous:
    """The same question for the continuous loop with nothing but the sector (section 7).

    Parameters
    ----------
    problem
        Plant, pixels and tolerance.
    gains
        N_G and N_T.
    """

    def __init__(self, problem: DesignProblem, gains: ChannelGains) -> None:
        self._problem, self._gains = problem, gains

    def held(self, sectors: Sectors) -> Held:
        """Bounds that hold in the limit; see `Promise.held`.

        Parameters
        ----------
        sectors
            delta_i.
        """
        problem, gains = self._problem, self._gains
        means = problem.pixels.sector_means(sectors)
        size = gains.amplified(means.constant, means.share)
        if size is None:
            return Held.nothing(problem)
        return replace(
            Held.nothing(problem),
            error=float(gains.state @ size),
            output=float((gains.output @ size).max()),
        )


def _through(matrix: FloatArray, sizes: FloatArray) -> FloatArray:
    """``|matrix| sizes``, where an entry of zero takes nothing of a signal without a bound."""
    return np.asarray((np.abs(matrix) * np.where(matrix != 0, sizes, 0.0)).sum(axis=1))


def _combined(gains: list[Gains], sizes: list[float]) -> Gains:
    """Bounds of the sum of signals of these sizes, one through each of the channels."""
    total: dict[str, Any] = {}
    for name in Gains.__dataclass_fields__:
        none = np.zeros(np.shape(getattr(gains[0], name)))[()]
        parts = [size * getattr(g, name) for g, size in zip(gains, sizes, strict=True) if size]
        total[name] = sum(parts, start=none)
    return Gains(**total)
