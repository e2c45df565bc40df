"""What K is fed with: the mean deviation, or one of every pixel group."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.wire.events import EventPacket
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.command_limiter import CommandLimiter
from dvs_hinf_controller.running.held_input import HeldInputResponse
from dvs_hinf_controller.running.intervals import ReferenceIntervals

Bools = NDArray[np.bool_]
Deviation = float | FloatArray
"""Input of K: a number, or one of every pixel group, shape (k,)."""


class Response(Protocol):
    """How the state of K answers inputs that are constant between given instants."""

    def transition(self, duration_s: float) -> FloatArray:
        """``exp(A t)``.

        Parameters
        ----------
        duration_s
            t >= 0, s.
        """

    def response(self, durations_s: FloatArray) -> FloatArray:
        """``int_0^t exp(A s) B ds`` for every t.

        Parameters
        ----------
        durations_s
            t >= 0, s.
        """

    def jumped(self, jumps: FloatArray, durations_s: FloatArray) -> FloatArray:
        """What jumps of the inputs have led to, shape (order,).

        Parameters
        ----------
        jumps
            Jumps of the input, or of every input.
        durations_s
            Times since each, s.
        """


class Means(Protocol):
    """What K takes of the pixels; `OneMean` and `GroupMeans` are the two ways."""

    @property
    def rest(self) -> Deviation:
        """Deviation while nothing is known."""

    @property
    def foresees(self) -> bool:
        """Whether the answer to silence is computed ahead."""

    def response(self, controller: LinearController) -> Response:
        """Response of K to the deviations.

        Parameters
        ----------
        controller
            K.
        """

    def lacks_pixels(self, known: ReferenceIntervals) -> bool:
        """Whether K has to rest for lack of pixels.

        Parameters
        ----------
        known
            Which pixels are active.
        """

    def deviation(self, known: ReferenceIntervals, limiter: CommandLimiter | None) -> Deviation:
        """Mean distance of the estimates from the luminosities of the set-point.

        Parameters
        ----------
        known
            Estimates; `lacks_pixels` is false of them.
        limiter
            What adds the luminosity that a command within limits lacks; None for no limit.
        """

    def jumps(
        self, jumps: FloatArray, packet: EventPacket, known: ReferenceIntervals
    ) -> FloatArray:
        """Jumps of the deviation at every event.

        Parameters
        ----------
        jumps
            Jump of the mean over all active pixels at every event, shape (E,).
        packet
            Events.
        known
            Which pixels are active.
        """

    def driven(self, gain: FloatArray, deviation: Deviation) -> FloatArray:
        """What a gain makes of a deviation, shape (p,).

        Parameters
        ----------
        gain
            Of every entry of the deviation.
        deviation
            Input of K.
        """


class OneMean:
    """Mean of the deviations over all active pixels.

    Parameters
    ----------
    problem
        Pixels and the set-point.
    """

    rest = 0.0
    foresees = True

    def __init__(self, problem: DesignProblem) -> None:
        self._target = problem.set_point_luminosity
        self._mean_target = float(self._target.mean())

    def response(self, controller: LinearController) -> HeldInputResponse:
        """Response of K to the mean; see `Means.response`."""
        return HeldInputResponse(controller.state_matrix, controller.input_vector)

    def lacks_pixels(self, known: ReferenceIntervals) -> bool:
        """Whether there is nothing to take the mean of; see `Means.lacks_pixels`."""
        return not known.active_count

    def deviation(self, known: ReferenceIntervals, limiter: CommandLimiter | None) -> float:
        """``mean(z_i - c'(x_d + dx_i))``; see `Means.deviation`."""
        target = self._mean_target
        if known.active_count != known.active.size:
            target = float(self._target[known.active].mean())
        if limiter is not None:
            target -= float(limiter.luminosity)
        return known.mean_estimate - target

    def jumps(
        self, jumps: FloatArray, packet: EventPacket, known: ReferenceIntervals
    ) -> FloatArray:
        """Jumps of the mean at every event, shape (E,); see `Means.jumps`."""
        return jumps

    def driven(self, gain: FloatArray, deviation: Deviation) -> FloatArray:
        """What a gain makes of the deviation; see `Means.driven`."""
        driven: FloatArray = gain * deviation
        return driven


class GroupMeans:
    """Means of the deviations over the active pixels of every pixel group.

    Parameters
    ----------
    problem
        Pixels, their groups and the set-point.
    """

    foresees = False

    def __init__(self, problem: DesignProblem) -> None:
        groups = problem.scene.groups
        assert groups is not None
        self._groups, self._width = groups, problem.scene.width
        self._count = problem.model.group_count
        self._target = problem.set_point_luminosity
        self.rest = np.zeros(self._count)

    def response(self, controller: LinearController) -> GroupResponse:
        """Response of K to the means; see `Means.response`."""
        return GroupResponse(controller)

    def lacks_pixels(self, known: ReferenceIntervals) -> bool:
        """Whether a group has no active pixel; see `Means.lacks_pixels`."""
        return not self.active_counts(known.active).all()

    def active_counts(self, active: Bools) -> NDArray[np.intp]:
        """Number of active pixels of every group, shape (k,).

        Parameters
        ----------
        active
            Pixels over which means go, shape (r,).
        """
        return np.bincount(self._groups[active], minlength=self._count)

    def deviation(self, known: ReferenceIntervals, limiter: CommandLimiter | None) -> FloatArray:
        """Mean of ``z_i - c_j'(x_d + dx_i)`` a group j, shape (k,); see `Means.deviation`."""
        active = known.active
        errors = (known.estimate - self._target)[active]
        sums = np.bincount(self._groups[active], weights=errors, minlength=self._count)
        means = np.asarray(sums / self.active_counts(active))
        return means if limiter is None else means + limiter.luminosity

    def jumps(
        self, jumps: FloatArray, packet: EventPacket, known: ReferenceIntervals
    ) -> FloatArray:
        """Jumps of the means of the groups at every event, shape (k, E); see `Means.jumps`."""
        counts = np.maximum(self.active_counts(known.active), 1)
        events = packet.events
        mine = self._groups[events['y'].astype(np.intp) * self._width + events['x']]
        of_its_own = jumps * (known.active_count / counts[mine])
        return np.where(mine == np.arange(self._count)[:, None], of_its_own, 0.0)

    def driven(self, gain: FloatArray, deviation: Deviation) -> FloatArray:
        """What a gain makes of the deviations; see `Means.driven`."""
        return np.asarray(gain @ np.asarray(deviation))


class GroupResponse:
    """Response of K to inputs of several groups, each constant between given instants.

    Parameters
    ----------
    controller
        K.
    """

    def __init__(self, controller: LinearController) -> None:
        self._columns = [
            HeldInputResponse(controller.state_matrix, np.ascontiguousarray(column))
            for column in controller.input_matrix.T
        ]

    def transition(self, duration_s: float) -> FloatArray:
        """``exp(A t)``; see `Response.transition`."""
        return self._columns[0].transition(duration_s)

    def response(self, durations_s: FloatArray) -> FloatArray:
        """The integrals, shape (len(durations_s), order, k); see `Response.response`."""
        return np.stack([column.response(durations_s) for column in self._columns], axis=2)

    def jumped(self, jumps: FloatArray, durations_s: FloatArray) -> FloatArray:
        """What jumps of the inputs have led to; see `Response.jumped`."""
        moved = [
            column.jumped(mine, durations_s)
            for column, mine in zip(self._columns, jumps, strict=True)
        ]
        return np.asarray(np.sum(moved, axis=0))


def means_of(problem: DesignProblem) -> Means:
    """`OneMean`, or `GroupMeans` where there are several pixel groups.

    Parameters
    ----------
    problem
        Pixels, their groups and the set-point.
    """
    return OneMean(problem) if problem.scene.groups is None else GroupMeans(problem)
