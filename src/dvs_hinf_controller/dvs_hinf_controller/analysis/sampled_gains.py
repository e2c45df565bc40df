"""Peak gains of the loop of the nodes, from everything that acts on it to all that counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from dvs_common.arrays import FloatArray
from dvs_hinf_controller.analysis.directions import largest_bound, lengths_of
from dvs_hinf_controller.analysis.flows import trapezoidal_weights
from dvs_hinf_controller.analysis.kernel import Kernel, sample_kernel
from dvs_hinf_controller.analysis.lifted_loop import LiftedLoop, SampledFlow

_CELL_GROWTH = 1.25


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
        return Gains(
            **{
                name: np.max([getattr(g, name) for g in (self, *others)], axis=0)
                for name in self.__dataclass_fields__
            }
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
        nodes = loop.interval_nodes(self._rtol)
        start = np.concatenate([np.zeros(n), loop.controller.input_matrix[:, group]])
        states = loop.after(nodes, start)
        columns, weights = loop.lifted(states), trapezoidal_weights(nodes)
        at_once = np.zeros((1, self._outputs.shape[1]))
        if np.any(feedthrough):
            response = loop.command_response(feedthrough)
            columns, weights = np.column_stack([columns, response.state]), np.append(weights, 1.0)
            at_once = response.outputs
        slop = self._chord_error(nodes, states)
        return self._gains(columns, weights, slop, _Direct.largest(at_once, n))

    def of_drive(self, drive: FloatArray) -> Gains:
        """Gains of a signal that adds to xdot, at every instant.

        Parameters
        ----------
        drive
            Direction, shape (n,).
        """
        loop = self._loop
        nodes = loop.interval_nodes(self._rtol)
        states = loop.after(nodes, np.concatenate([drive, np.zeros(loop.controller.order)]))
        weights = trapezoidal_weights(nodes)
        slop = self._chord_error(nodes, states)
        direct = _Direct.sum(loop.at_once(states), weights, self._states)
        return self._gains(loop.lifted(states), weights, slop, direct)

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
            self._gains(loop.lifted(state[None]), np.array([width]), none, direct)
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
        norms = lengths_of(kernel.values[:, :, :n])
        return self._assembled(np.abs(kernel.values).max(axis=(0, 1)), float(norms.max()))

    def _chord_error(self, nodes: FloatArray, states: FloatArray) -> FloatArray:
        """What the trapezoids within a period may miss, summed over all periods, (1 + p,)."""
        curves = self._loop.lifted(states @ self._loop.interval_curve.T) / self._scale[:, None]
        cells = np.diff(nodes) ** 3 / 12 * _CELL_GROWTH
        weights = np.zeros(nodes.size)
        weights[1:] += cells / 2
        weights[:-1] += cells / 2
        totals = [
            bound.size(curves, weights) + self._flow.per_second * bound.tail(curves, weights)
            for bound in self._bounds
        ]
        if not totals:
            return np.full(1 + self._outputs.shape[1], math.inf)
        return np.asarray(np.min(totals, axis=0))

    def _gains(
        self, columns: FloatArray, weights: FloatArray, slop: FloatArray, direct: _Direct
    ) -> Gains:
        kernel = self._kernel(columns, weights)
        if kernel is None:
            return self._assembled(np.full(self._outputs.shape[1], math.inf), math.inf)
        sums = np.einsum('i,pij->pj', kernel.weights, np.abs(kernel.values)).max(axis=0)
        worst = largest_bound(kernel.values[:, :, : self._states], kernel.weights)
        error = worst + kernel.state_quadrature + kernel.state_tail
        return self._assembled(
            sums + kernel.slop + slop[1:] + direct.rows, error + float(slop[0]) + direct.norm
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
