"""The controller as it runs: the estimator and K, advanced exactly from event to event."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.wire.anchor import Anchor
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.events import EventPacket
from dvs_common.wire.keyframe import Keyframe
from dvs_hinf_controller.analysis.budget import Budget
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.command_limiter import CommandLimiter
from dvs_hinf_controller.running.look_ahead import LookAhead, Silence
from dvs_hinf_controller.running.means import Deviation, means_of
from dvs_hinf_controller.running.reference_state import Synchrony, Taken
from dvs_hinf_controller.running.reference_watch import ReferenceWatch
from dvs_hinf_controller.sensor_uncertainty import SensorUncertainty

_KEPT_STEPS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReport:
    """What the controller noticed.

    Parameters
    ----------
    lost_events
        Events missing before this packet, by the running event number.
    repeated
        Whether the packet is the last one once more, so that nothing has changed.
    restarted
        Whether time has begun anew, and the estimator and K with it.
    resynchronised_pixels
        Pixels that a keyframe has put right; None where there was no keyframe to apply.
    contradicted_pixels
        Pixels whose reference an anchor has contradicted.
    """

    lost_events: int = 0
    repeated: bool = False
    restarted: bool = False
    resynchronised_pixels: int | None = None
    contradicted_pixels: int = 0


_NOTHING_NOTICED = PacketReport()


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
    command_rate_limit
        Largest change of ``u_o`` in a second, shape (m,), infinite where there is none; None for
        no limit.
    uncertainty
        How far the sensor may be from an ideal one; None for an ideal one.
    pixel_mask
        Pixels that are not to be used.
    holds_unknown
        Whether the last command is held while no reference is known, and not the equilibrium
        input.
    """

    def __init__(
        self,
        problem: DesignProblem,
        controller: LinearController,
        *,
        event_threshold: float,
        command_limit: FloatArray,
        command_rate_limit: FloatArray | None = None,
        uncertainty: SensorUncertainty | None = None,
        pixel_mask: Sequence[int] = (),
        holds_unknown: bool = False,
    ) -> None:
        self.limiter = CommandLimiter.where_limited(problem, command_limit, command_rate_limit)
        self._holds_unknown = holds_unknown
        self._aim(problem, controller)
        self.references = ReferenceWatch(
            problem.bounds,
            event_threshold=event_threshold,
            log_base=problem.log_base,
            width=problem.scene.width,
            uncertainty=uncertainty or SensorUncertainty(),
            masked=pixel_mask,
        )
        self._begin()

    def _aim(self, problem: DesignProblem, controller: LinearController) -> None:
        self.problem = problem
        self._controller = controller
        self._means = means_of(problem)
        self.response = self._means.response(controller)
        self._steps: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._feedforward = problem.equilibrium.feedforward
        self._ahead = LookAhead()

    def _begin(self) -> None:
        self._duration_ns = 0
        self.state = np.zeros(self._controller.order)
        self._resting = self._feedforward
        self.deviation = self._means.rest
        self.lacks_pixels = False
        if self.limiter is not None:
            self.limiter.begin(self._feedforward)
        self._refresh()
        self._limit(0)

    def _refresh(self) -> None:
        """Take over what is known now; where nothing is, rest until something is."""
        lacks_pixels = self._means.lacks_pixels(self.references.intervals)
        if lacks_pixels and not self.lacks_pixels:
            self._resting = (
                self._command_of(self.state) if self._holds_unknown else self._feedforward
            )
            self.state = np.zeros(self._controller.order)
        self.lacks_pixels = lacks_pixels
        self.deviation = self._mean_deviation()

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
            self.state = np.zeros(controller.order)
        if not self._holds_unknown:
            self._resting = self._feedforward
        self.deviation = self._mean_deviation()

    def _mean_deviation(self) -> Deviation:
        if self.lacks_pixels:
            return self._means.rest
        return self._means.deviation(self.references.intervals, self.limiter)

    @property
    def counts(self) -> NDArray[np.int64]:
        """N of every pixel, shape (r,)."""
        return self.references.intervals.counts

    @property
    def estimate(self) -> FloatArray:
        """Estimate z of every luminosity, shape (r,)."""
        estimate: FloatArray = self.references.intervals.estimate
        return estimate

    @property
    def event_threshold(self) -> float:
        """Threshold h at which events are counted now."""
        return self.references.intervals.event_threshold

    def read_budget(self, delta_certified: float) -> Budget:
        """What was used at most, since the last reading, of the error that a certificate allows.

        Parameters
        ----------
        delta_certified
            Relative error of the estimate up to which the tolerance is guaranteed.
        """
        known = self.references.intervals
        return Budget(
            threshold=known.log_thresholds,
            ignorance=known.read_widest(),
            delta_certified=delta_certified,
            unknown_pixels=known.unknown_count,
            masked_pixels=self.references.health.read_masked(),
        )

    @property
    def synchrony(self) -> Synchrony:
        """How far the counts can be trusted."""
        return self.references.synchrony

    @property
    def command(self) -> FloatArray:
        """``u_o = Cc xc + Dc e - B^+ A x_d`` within the limits, shape (m,).

        While no reference is known, what holds the equilibrium, or the last command.
        """
        return self._wanted if self.limiter is None else self.limiter.command

    @property
    def _wanted(self) -> FloatArray:
        """The command before any limit."""
        if self.lacks_pixels:
            return self._resting
        ahead = self._ahead.at(self.state, deviation=self.deviation)
        return self._command_of(self.state) if ahead is None else ahead.command

    def _command_of(self, state: FloatArray) -> FloatArray:
        k = self._controller
        command = k.output_matrix @ state + self._means.driven(k.feedthrough, self.deviation)
        return np.asarray(command + self._feedforward)

    def _limit(self, duration_ns: int) -> None:
        if self.limiter is not None:
            self.limiter.take(self._wanted, as_seconds(duration_ns), is_resting=self.lacks_pixels)

    def look_ahead(self) -> None:
        """Work out, while there is time, the answer to a next packet that is as long and empty."""
        if not self._means.foresees:
            return
        state = self._held(self._duration_ns)
        self._ahead.keep(
            Silence(
                duration_ns=self._duration_ns,
                before=self.state,
                deviation=self.deviation,
                state=state,
                command=self._command_of(state),
            )
        )

    def foreseen(self, packet: EventPacket) -> FloatArray | None:
        """Command that `take` is about to lead to, where that was worked out ahead; else None.

        Who waits for the command need not wait for the bookkeeping of an empty packet.

        Parameters
        ----------
        packet
            Next packet.
        """
        duration_ns = self._duration_of_silence_ns(packet)
        if duration_ns is None:
            return None
        ahead = self._ahead.after(duration_ns, before=self.state, deviation=self.deviation)
        return None if ahead is None else ahead.command

    def _duration_of_silence_ns(self, packet: EventPacket) -> int | None:
        """Length of a step in which K alone moves; None where a packet brings anything else."""
        if self.lacks_pixels or self.limiter is not None:
            return None
        return self.references.duration_of_silence_ns(packet)

    def take(self, packet: EventPacket) -> PacketReport:
        """Advance to the packet's stamp through all of its events.

        The last packet once more changes nothing. One of the same stamp with other events adds
        them at that instant. An event from before the previous packet acts from that packet's
        stamp on.

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
            If its stamp is an outlier, an event lies outside of the pixel array or after the
            packet's stamp, events are not in order, a polarity or sign is not +1 or -1, or events
            lead out of the range of numbers; nothing has changed then.
        """
        silence_ns = self._duration_of_silence_ns(packet)
        if silence_ns is not None:
            self.references.pass_silence(packet.stamp_ns)
            self._duration_ns = silence_ns
            self._keep_still()
            return _NOTHING_NOTICED
        if len(packet.events):
            self._check(packet)
        taken = self.references.take(packet)
        if taken.repeated:
            return PacketReport(repeated=True)
        if taken.anew:
            self._begin()
        self._duration_ns = taken.duration_ns
        if len(taken.jumps):
            ages_ns = np.minimum(-packet.events['t'].astype(np.int64), self._duration_ns)
            jumps = self._means.jumps(taken.jumps, packet, self.references.intervals)
            moved = self.response.jumped(jumps, as_seconds(ages_ns))
            self.state = self._held(self._duration_ns) + moved
        else:
            self._keep_still()
        if self.lacks_pixels:
            self.state = np.zeros(self._controller.order)
        if self.limiter is not None:
            self.limiter.advance(as_seconds(self._duration_ns))
        report = self._noticed(taken)
        self._limit(self._duration_ns)
        return report

    def _noticed(self, taken: Taken) -> PacketReport:
        self._refresh()
        report = PacketReport(
            lost_events=taken.lost,
            restarted=taken.anew,
            resynchronised_pixels=taken.corrected,
            contradicted_pixels=taken.contradicted,
        )
        return _NOTHING_NOTICED if report == _NOTHING_NOTICED else report

    def _keep_still(self) -> None:
        """Pass an interval without events."""
        ahead = self._ahead.after(self._duration_ns, before=self.state, deviation=self.deviation)
        self.state = self._held(self._duration_ns) if ahead is None else ahead.state

    def take_keyframe(self, keyframe: Keyframe) -> PacketReport:
        """Take the bounds that the sensor gives; see `ReferenceWatch.take_keyframe`.

        Parameters
        ----------
        keyframe
            State of the sensor.

        Raises
        ------
        MessageError
            If it does not fit; nothing has changed then.
        """
        taken = self.references.take_keyframe(keyframe)
        if taken.anew:
            self._begin()
        return self._noticed(taken)

    def take_anchor(self, anchor: Anchor) -> PacketReport:
        """Take an absolute measurement; see `ReferenceWatch.take_anchor`.

        Parameters
        ----------
        anchor
            What was measured.

        Raises
        ------
        MessageError
            If it does not fit; nothing has changed then.
        """
        return self._noticed(self.references.take_anchor(anchor))

    def _check(self, packet: EventPacket) -> None:
        events = packet.events
        scene = self.problem.scene
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
            return self.state
        step = self._steps.get(duration_ns)
        if step is None:
            duration_s = as_seconds(duration_ns)
            step = (
                self.response.transition(duration_s),
                self.response.response(np.array([duration_s]))[0],
            )
            if len(self._steps) < _KEPT_STEPS:
                self._steps[duration_ns] = step
        transition, gain = step
        return np.asarray(transition @ self.state + self._means.driven(gain, self.deviation))
