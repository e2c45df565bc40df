"""Peak gains of the loop of the nodes, from everything that acts on it to all that counts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.directions import largest_bound, lengths_of
from dvs_hinf_controller.analysis.flows import trapezoidal_weights
from dvs_hinf_controller.analysis.kernel import Kernel, sample_kernel
from dvs_hinf_controller.analysis.lifted_loop import CHORD_SHARE, LiftedLoop, SampledFlow

_CELL_GROWTH = 1.25
# Chords' errors at first and at last, over the relative width that is aimed at.
_FIRST_CHORD, _LAST_CHORD = 64.0, 0.02
_MOST_PASSES = 2
# How much more than their share chords, and the sampled kernel, may miss.
_ENOUGH, _FAR = 2.0, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """Upper bounds of what a signal of size 1 does, at every instant.

    Parameters
    ----------
    error
        Of ``||W x||``.
    states
        Of every ``|x_i|``, shape (n,).
    output
        Of ``|c'x|`` of every pixel group, shape (k,).
    output_rate
        Of their derivatives, at the phases of a period that were looked at, shape (k,).
    output_curve
        Of their second derivatives, likewise, shape (k,).
    commands
        Of every ``|u_j|``, shape (m,).
    changes
        Of every ``|u_j|`` change from sample to sample, shape (m,).
    """

    error: float
    states: FloatArray
    output: FloatArray
    output_rate: FloatArray
    output_curve: FloatArray
    commands: FloatArray
    changes: FloatArray

    def largest(self, *others: Gains) -> Gains:
        """The larger value of everything.

        Parameters
        ----------
        *others
            Gains of the same loop.
        """
        return self._merged(np.maximum, others)

    def least(self, *others: Gains) -> Gains:
        """The smaller value of everything: of bounds of the same, each of which holds.

        Parameters
        ----------
        *others
            Gains of the same loop and signal.
        """
        return self._merged(np.minimum, others)

    def excess_over(self, smaller: Gains) -> float:
        """Largest share by which the gains to error and output exceed others.

        Parameters
        ----------
        smaller
            Gains of the same loop and signal.
        """
        own, others = (np.append(g.output, g.error) for g in (self, smaller))
        return float(np.max((own - others) / np.maximum(others, 1e-300)))

    def _merged(self, pick: np.ufunc, others: tuple[Gains, ...]) -> Gains:
        each = (self, *others)
        return Gains(
            error=float(pick.reduce([g.error for g in each])),
            **{
                name: pick.reduce([getattr(g, name) for g in each])
                for name in self.__dataclass_fields__
                if name != 'error'
            },
        )


class SampledGains:
    """Peak gains of one lifted loop.

    ``N(theta) = sum over past periods of integral |v'g(theta, s)| ds``; the largest over the
    phases theta, and ``spacing^2 / 8`` of x'' more for what lies between two of them.

    Parameters
    ----------
    loop
        Stable.
    rtol
        Relative width that is aimed at.
    """

    def __init__(self, loop: LiftedLoop, *, rtol: float = 3e-4) -> None:
        self._loop, self._rtol = loop, rtol
        _, (scale, _) = scipy.linalg.matrix_balance(loop.matrix, permute=False, separate=True)
        self._scale = scale
        self._flow = SampledFlow(loop.matrix / scale[:, None] * scale, loop.timing.period)
        self._outputs = loop.outputs * scale
        self._states = loop.model.state_count
        self._bounds = self._flow.bounds(self._outputs, self._states)

    def of_measurement(self, group: int = 0) -> Gains:
        """Gains of an error of a measured mean deviation, at every instant.

        Parameters
        ----------
        group
            Pixel group over whose pixels the mean goes.
        """
        loop, n = self._loop, self._states
        feedthrough = loop.controller.feedthrough_matrix[:, group]
        start = np.concatenate([np.zeros(n), loop.controller.input_matrix[:, group]])
        response = loop.command_response(feedthrough) if np.any(feedthrough) else None
        at_once = np.zeros((1, self._outputs.shape[1])) if response is None else response.outputs
        direct = _Direct.largest(at_once, n)

        def with_nodes(nodes: FloatArray) -> _Pass:
            states = loop.after(nodes, start)
            columns, weights = loop.lifted(states), trapezoidal_weights(nodes)
            if response is not None:
                columns = np.column_stack([columns, response.state])
                weights = np.append(weights, 1.0)
            return self._pass(columns, weights, self._chord_error(nodes, states), direct)

        return self._with_few_nodes(with_nodes)

    def of_drive(self, drive: FloatArray) -> Gains:
        """Gains of a signal that adds to xdot, at every instant.

        Parameters
        ----------
        drive
            Direction, shape (n,).
        """
        loop = self._loop
        start = np.concatenate([drive, np.zeros(loop.controller.order)])

        def with_nodes(nodes: FloatArray) -> _Pass:
            states, weights = loop.after(nodes, start), trapezoidal_weights(nodes)
            direct = _Direct.sum(loop.at_once(states), weights, self._states)
            slop = self._chord_error(nodes, states)
            return self._pass(loop.lifted(states), weights, slop, direct)

        return self._with_few_nodes(with_nodes)

    def of_pulse(self, drive: FloatArray, width: float) -> Gains:
        """Gains of a pulse on xdot, once a period, within `width` of the switch of the command.

        Parameters
        ----------
        drive
            Direction, shape (n,).
        width
            s; the pulse lasts as long.
        """
        loop, timing = self._loop, self._loop.timing
        start = np.concatenate([drive, np.zeros(loop.controller.order)])
        left = timing.period - timing.rest
        ends = np.clip([left - width, left, left + width], 0, timing.period)
        states = loop.after(ends, start)
        direct = _Direct.largest(
            width * loop.at_once(loop.after(loop.interval_nodes(self._rtol), start)), self._states
        )
        none = np.zeros(1 + self._outputs.shape[1])
        found = [
            self._pass(loop.lifted(state[None]), np.array([width]), none, direct).gains
            for state in states
        ]
        return found[0].largest(*found[1:])

    def free(self, start: FloatArray) -> Gains:
        """Largest values of all signals from a start on, with nothing acting on the loop.

        Parameters
        ----------
        start
            ``x - x_d``, shape (n,); K starts at zero.
        """
        loop, n = self._loop, self._states
        states = np.concatenate([start, np.zeros(loop.controller.order)])[None]
        kernel = self._kernel(loop.lifted(states), np.ones(1))
        if kernel is None:
            infinite = np.full(self._outputs.shape[1], math.inf)
            return self._assembled(infinite, math.inf)
        values = kernel.values
        norms = lengths_of(values[:, :, :n])
        return self._assembled(np.abs(values).max(axis=(0, 1)), float(norms.max()))

    def _with_few_nodes(self, with_nodes: Callable[[FloatArray], _Pass]) -> Gains:
        """Gains with as few instants in a period as keep what chords miss within its share.

        A mode that is fast but hardly moved asks for few; where they are so many that too few
        periods are sampled, fewer are better. All bounds hold: the least of each is taken.
        """
        share, chord = CHORD_SHARE * self._rtol, _FIRST_CHORD * self._rtol
        found = with_nodes(self._loop.interval_nodes(chord))
        gains = found.gains
        for _ in range(_MOST_PASSES):
            if not _ENOUGH * share < found.between_nodes < math.inf:
                break
            finer = max(chord * share / found.between_nodes, _LAST_CHORD * self._rtol)
            found = with_nodes(self._loop.interval_nodes(finer))
            gains = gains.least(found.gains)
            if found.between_samples > _FAR * share:
                between = math.sqrt(finer * chord)
                return gains.least(with_nodes(self._loop.interval_nodes(between)).gains)
            chord = finer
        return gains

    def _chord_error(self, nodes: FloatArray, states: FloatArray) -> FloatArray:
        """What the trapezoids within a period may miss, summed over all periods, (1 + p,)."""
        curves = self._loop.lifted(states @ self._loop.interval_curve.T) / self._scale[:, None]
        cells = np.diff(nodes) ** 3 / 12 * _CELL_GROWTH
        weights = np.zeros(nodes.size)
        weights[1:] += cells / 2
        weights[:-1] += cells / 2
        if not self._bounds:
            return np.full(1 + self._outputs.shape[1], math.inf)
        found = np.array([bound.size_and_tail(curves, weights) for bound in self._bounds])
        return np.asarray(np.min(found[:, 0] + self._flow.per_second * found[:, 1], axis=0))

    def _pass(
        self, columns: FloatArray, weights: FloatArray, slop: FloatArray, direct: _Direct
    ) -> _Pass:
        kernel = self._kernel(columns, weights)
        if kernel is None:
            infinite = np.full(self._outputs.shape[1], math.inf)
            return _Pass(gains=self._assembled(infinite, math.inf))
        summed = kernel.summed(self._states)
        rows = summed.sums.max(axis=0) + direct.rows
        error = largest_bound(summed.values, kernel.weights) + direct.norm
        seen = self._assembled(rows, error)
        rows, error = rows + kernel.slop, error + kernel.state_quadrature + kernel.state_tail
        sampled = self._assembled(rows, error)
        gains = self._assembled(rows + slop[1:], error + float(slop[0]))
        return _Pass(
            gains=gains,
            between_nodes=gains.excess_over(sampled),
            between_samples=sampled.excess_over(seen),
        )

    def _kernel(self, columns: FloatArray, weights: FloatArray) -> Kernel | None:
        return sample_kernel(
            self._flow,
            starts=columns / self._scale[:, None],
            start_weights=weights,
            outputs=self._outputs,
            states=self._states,
            rtol=self._rtol,
        )

    def _assembled(self, rows: FloatArray, error: float) -> Gains:
        """Gains by name, with what may lie between two phases."""
        n, m = self._states, self._loop.model.input_count
        k = self._loop.model.group_count
        between = self._loop.phase_spacing**2 / 8
        curves, output, commands = rows[n : 2 * n], rows[2 * n :], rows[2 * n + 3 * k :]
        plain = rows if self._loop.weights is None else commands[2 * m :]
        return Gains(
            error=error + between * float(np.linalg.norm(curves)),
            states=plain[:n] + between * plain[n : 2 * n],
            output=output[:k] + between * output[2 * k : 3 * k],
            output_rate=output[k : 2 * k],
            output_curve=output[2 * k : 3 * k],
            commands=commands[:m],
            changes=commands[m : 2 * m],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pass:
    """Gains, and the shares of them that bound what was missed."""

    gains: Gains
    between_nodes: float = math.inf
    between_samples: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class _Direct:
    """What a signal does within its own period."""

    rows: FloatArray
    norm: float

    @classmethod
    def largest(cls, outputs: FloatArray, states: int) -> _Direct:
        norms = np.linalg.norm(outputs[:, :states], axis=1)
        return cls(rows=np.abs(outputs).max(axis=0), norm=float(norms.max()))

    @classmethod
    def sum(cls, outputs: FloatArray, weights: FloatArray, states: int) -> _Direct:
        norms = np.linalg.norm(outputs[:, :states], axis=1)
        return cls(rows=weights @ np.abs(outputs), norm=float(weights @ norms))
