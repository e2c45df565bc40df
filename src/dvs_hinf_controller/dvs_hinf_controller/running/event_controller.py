"""The controller as it runs: the estimator and K, advanced exactly from event to event."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EventPacket
from dvs_common.wire.index_watch import Order
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.held_input import HeldInputResponse
from dvs_hinf_controller.running.interval_arithmetic import Told, require_finite
from dvs_hinf_controller.running.intervals import ReferenceIntervals
from dvs_hinf_controller.running.sensor_uncertainty import SensorUncertainty
from dvs_hinf_controller.running.synchroniser import Synchroniser, Synchrony

_KEPT_STEPS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReport:
    """What the controller noticed.

    Parameters
    ----------
    lost_events
        Events missing before this packet, by the running event number.
    restarted
        Whether the packet lies before the previous one, so that everything began anew.
    resynchronised_pixels
        Pixels whose count a keyframe has put right; None where there was no keyframe to apply.
    """

    lost_events: int = 0
    restarted: bool = False
    resynchronised_pixels: int | None = None


_NOTHING_NOTICED = PacketReport()


@dataclass(frozen=True, slots=True, eq=False)
class _Ahead:
    """What a step of silence leads to, worked out before it is known to be one."""

    duration_ns: int
    before: FloatArray
    deviation: float
    state: FloatArray
    command: FloatArray


class EventController:
    """Estimator (paper, eqs. 12, 13) and K, fed by packets.

    Between events the estimate is constant, so K has a closed form; all events of a packet enter
    in one vectorised step, each at its own stamp. The command is that of the continuous-time
    controller at the packet's stamp.

    Parameters
    ----------
    problem
        Plant, set-point, pixels and what is known of q(0).
    controller
        K.
    event_threshold
        h, in logarithms to the problem's base.
    command_limit
        Largest ``|u_o|``, shape (m,); infinite where there is none.
    """

    def __init__(
        self,
        problem: DesignProblem,
        controller: LinearController,
        *,
        event_threshold: float,
        command_limit: FloatArray,
    ) -> None:
        self._event_threshold = event_threshold
        self._limit = command_limit if np.isfinite(command_limit).any() else None
        self._aim(problem, controller)
        self._reset()

    def _aim(self, problem: DesignProblem, controller: LinearController) -> None:
        self._problem = problem
        self._controller = controller
        self._response = HeldInputResponse(controller.state_matrix, controller.input_vector)
        self._steps: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._mean_target = float(problem.set_point_luminosity.mean())
        self._feedforward = problem.equilibrium.feedforward
        self._ahead: _Ahead | None = None

    def _reset(self) -> None:
        self._estimator = ReferenceIntervals(
            self._problem.bounds,
            event_threshold=self._event_threshold,
            log_base=self._problem.log_base,
            uncertainty=SensorUncertainty(),
        )
        self._synchroniser = Synchroniser()
        self._stamp_ns: int | None = None
        self._duration_ns = 0
        self._threshold_changes: deque[tuple[int, float]] = deque()
        self._first_ns: int | None = None
        self._state = np.zeros(self._controller.order)
        self._deviation = self._mean_deviation()

    def redirect(self, problem: DesignProblem, controller: LinearController) -> None:
        """Aim at another set-point from the last packet on; what is known of the pixels stays.

        Parameters
        ----------
        problem
            Problem with the new set-point.
        controller
            K for it; its state starts at zero unless it is the K that runs.
        """
        same = all(
            np.array_equal(getattr(controller, name), getattr(self._controller, name))
            for name in ('state_matrix', 'input_vector', 'output_matrix', 'feedthrough')
        )
        self._aim(problem, controller)
        if not same:
            self._state = np.zeros(controller.order)
        self._deviation = self._mean_deviation()

    def announce_threshold(self, after_ns: int, event_threshold: float) -> bool:
        """Note that events stamped after `after_ns` are fired at another threshold.

        A sensor announces the threshold with its first sample too; one that does so in the midst
        of our packets has started again, with references that are not known here.

        Parameters
        ----------
        after_ns
            Last instant of the present threshold, ns.
        event_threshold
            New h.

        Returns
        -------
        bool
            False if later events have already been counted at the present threshold: the new one
            holds at once, but only a keyframe can tell where the references are.
        """
        if event_threshold == self._latest_threshold():
            if self._first_ns is not None and after_ns > self._first_ns:
                self._synchroniser.distrust()
            return True
        if self._stamp_ns is not None and self._stamp_ns > after_ns:
            self._change_threshold(event_threshold)
            self._threshold_changes.clear()
            self._synchroniser.give_up()
            return False
        self._threshold_changes.append((after_ns, event_threshold))
        return True

    def _mean_deviation(self) -> float:
        return self._estimator.mean_estimate - self._mean_target

    @property
    def counts(self) -> NDArray[np.int64]:
        """N of every pixel, shape (r,)."""
        return self._estimator.counts

    @property
    def estimate(self) -> FloatArray:
        """Estimate z of every luminosity, shape (r,)."""
        estimate: FloatArray = self._estimator.estimate
        return estimate

    @property
    def event_threshold(self) -> float:
        """Threshold h at which events are counted now."""
        return self._estimator.event_threshold

    @property
    def synchrony(self) -> Synchrony:
        """How far the counts can be trusted."""
        return self._synchroniser.state

    @property
    def command(self) -> FloatArray:
        """``u_o = Cc xc + Dc e - B^+ A x_d`` within the limits, shape (m,)."""
        ahead = self._ahead
        if ahead is not None and ahead.state is self._state and ahead.deviation == self._deviation:
            return ahead.command
        return self._command_of(self._state)

    def _command_of(self, state: FloatArray) -> FloatArray:
        k = self._controller
        command = k.output_matrix @ state + k.feedthrough * self._deviation
        command = command + self._feedforward
        return command if self._limit is None else np.clip(command, -self._limit, self._limit)

    def look_ahead(self) -> None:
        """Work out, while there is time, the answer to a next packet that is as long and empty."""
        state = self._held(self._duration_ns)
        self._ahead = _Ahead(
            duration_ns=self._duration_ns,
            before=self._state,
            deviation=self._deviation,
            state=state,
            command=self._command_of(state),
        )

    def take(self, packet: EventPacket) -> PacketReport:
        """Advance to the packet's stamp through all of its events.

        A packet stamped before the previous one starts everything anew; one with the same stamp
        adds its events at that instant. An event from before the previous packet acts from that
        packet's stamp on.

        Parameters
        ----------
        packet
            Events sorted by time.

        Returns
        -------
        PacketReport
            Losses and restarts.

        Raises
        ------
        MessageError
            If an event lies outside of the pixel array or after the packet's stamp, events are not
            in order, or a polarity or sign is not +1 or -1; nothing has changed then. If the
            events lead out of the range of numbers; only a keyframe makes the counts right then.
        """
        events = packet.events
        if len(events):
            self._check(packet)
        restarted = self._stamp_ns is not None and packet.stamp_ns < self._stamp_ns
        if restarted:
            self._event_threshold = self._latest_threshold()
            self._reset()
            self._synchroniser.accept_any_index()
        while self._threshold_changes and packet.stamp_ns > self._threshold_changes[0][0]:
            self._change_threshold(self._threshold_changes.popleft()[1])
        if self._stamp_ns is None:
            self._first_ns = self._stamp_ns = packet.stamp_ns
        self._duration_ns = packet.stamp_ns - self._stamp_ns
        self._stamp_ns = packet.stamp_ns
        lost = self._count(packet) if len(events) else self._keep_still(packet.stamp_ns)
        resynchronised = self._resynchronise()
        if not restarted and not lost and resynchronised is None:
            return _NOTHING_NOTICED
        return PacketReport(
            lost_events=lost, restarted=restarted, resynchronised_pixels=resynchronised
        )

    def _keep_still(self, stamp_ns: int) -> int:
        """Pass an interval without events; nothing can be missing before it."""
        self._synchroniser.note_silence(stamp_ns)
        ahead = self._ahead
        if (
            ahead is not None
            and ahead.before is self._state
            and ahead.deviation == self._deviation
            and ahead.duration_ns == self._duration_ns
        ):
            self._state = ahead.state
        else:
            self._state = self._held(self._duration_ns)
        return 0

    def _count(self, packet: EventPacket) -> int:
        """Pass an interval through its events; return how many are missing before it."""
        events = packet.events
        pixels = events['y'].astype(np.intp) * self._problem.scene.width + events['x']
        polarities, signs = events['polarity'], events['sign']
        step = self._synchroniser.note(packet.stamp_ns, events['index'], pixels, polarities, signs)
        if step.order is Order.REPEATED:
            return self._keep_still(packet.stamp_ns)
        try:
            jumps = self._estimator.apply(pixels, polarities, signs)
        except MessageError:
            self._synchroniser.give_up()
            raise
        ages_ns = np.minimum(-events['t'].astype(np.int64), self._duration_ns)
        responses = self._response.response(as_seconds(ages_ns))
        self._state = self._held(self._duration_ns) + jumps @ responses
        self._deviation = self._mean_deviation()
        return step.lost

    def take_keyframe(self, keyframe: Keyframe) -> PacketReport:
        """Verify the counts by a keyframe, or put them right; one of the future waits its turn.

        Parameters
        ----------
        keyframe
            State of the sensor.

        Raises
        ------
        MessageError
            If it is of another pixel array.
        """
        if keyframe.counts.size != self.counts.size:
            raise MessageError(
                f'keyframe of {keyframe.counts.size} pixels, the array has {self.counts.size}'
            )
        self._synchroniser.offer(keyframe)
        return PacketReport(resynchronised_pixels=self._resynchronise())

    def _resynchronise(self) -> int | None:
        if self._stamp_ns is None:
            return None
        keyframe = self._synchroniser.resolve(self._stamp_ns)
        if keyframe is None:
            return None
        log_base = math.log(self._problem.log_base)
        require_finite((keyframe.counts * self.event_threshold + keyframe.moved) * log_base)
        growth = np.exp(keyframe.moved * log_base)
        bounds = self._problem.bounds
        corrected = self._estimator.restart(
            Told(
                event_threshold=self.event_threshold,
                counts=keyframe.counts,
                signs=keyframe.signs,
                lower=bounds.lower * growth,
                upper=bounds.upper * growth,
                age_s=0.0,
                events=0,
            )
        )
        if corrected is None:
            return 0
        self._deviation = self._mean_deviation()
        return corrected

    def _latest_threshold(self) -> float:
        """The last threshold that the sensor announced."""
        if self._threshold_changes:
            return self._threshold_changes[-1][1]
        return self.event_threshold

    def _change_threshold(self, event_threshold: float) -> None:
        self._estimator.change_threshold(event_threshold)
        self._synchroniser.start_epoch()
        self._deviation = self._mean_deviation()

    def _check(self, packet: EventPacket) -> None:
        events = packet.events
        scene = self._problem.scene
        if int(events['x'].max()) >= scene.width or int(events['y'].max()) >= scene.height:
            raise MessageError(
                f'event at x = {events["x"].max()}, y = {events["y"].max()} lies outside of the '
                f'{scene.width} x {scene.height} pixels'
            )
        if int(events['t'].max()) > 0 or np.any(np.diff(events['t']) < 0):
            raise MessageError("event times must not decrease nor exceed the packet's stamp")
        if np.any(np.abs(events['polarity']) != 1) or np.any(np.abs(events['sign']) != 1):
            raise MessageError('polarity and sign must be +1 or -1')

    def _held(self, duration_ns: int) -> FloatArray:
        """State of K after a time in which the estimate holds its last value."""
        if duration_ns == 0:
            return self._state
        step = self._steps.get(duration_ns)
        if step is None:
            duration_s = as_seconds(duration_ns)
            step = (
                self._response.transition(duration_s),
                self._response.response(np.array([duration_s]))[0],
            )
            if len(self._steps) < _KEPT_STEPS:
                self._steps[duration_ns] = step
        transition, gain = step
        return transition @ self._state + gain * self._deviation
