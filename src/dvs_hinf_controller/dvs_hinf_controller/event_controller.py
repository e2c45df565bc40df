"""The controller as it runs: the estimator and K, advanced exactly from event to event."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.held_input import HeldInputResponse
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.sector import sector
from dvs_interfaces.cdr import MessageError
from dvs_interfaces.events import INDEX_MODULUS, EventPacket
from dvs_interfaces.model import FloatArray

_NANOSECOND_S = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class PacketReport:
    """What the controller noticed in one packet.

    Parameters
    ----------
    lost_events
        Events missing before this packet, by the running event number.
    restarted
        Whether the packet lies before the previous one, so that everything began anew.
    """

    lost_events: int = 0
    restarted: bool = False


class EventController:
    """Zero-order-hold estimator (paper, eqs. 8, 9) and K, fed by packets.

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
        self._controller = controller
        self._response = HeldInputResponse(controller.state_matrix, controller.input_vector)
        constants = sector(
            problem.bounds, event_threshold=event_threshold, log_base=problem.log_base
        )
        self._initial_estimate = constants.initial_estimate
        self._log_step = event_threshold * math.log(problem.log_base)
        self._width = problem.scene.width
        self._height = problem.scene.height
        self._mean_target = float(problem.set_point_luminosity.mean())
        self._feedforward = problem.equilibrium.feedforward
        self._limit = command_limit if np.isfinite(command_limit).any() else None
        self._steps: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._reset()

    def _reset(self) -> None:
        self.counts = np.zeros(self._initial_estimate.size, dtype=np.int64)
        self.estimate = self._initial_estimate.copy()
        self._next_index = 0
        self._stamp_ns: int | None = None
        self._state = np.zeros(self._controller.order)
        self._deviation = self._mean_deviation()

    def _mean_deviation(self) -> float:
        return float(self.estimate.mean()) - self._mean_target

    @property
    def command(self) -> FloatArray:
        """``u_o = Cc xc + Dc e - B^+ A x_d`` within the limits, shape (m,)."""
        k = self._controller
        command = k.output_matrix @ self._state + k.feedthrough * self._deviation
        command = command + self._feedforward
        return command if self._limit is None else np.clip(command, -self._limit, self._limit)

    def take(self, packet: EventPacket) -> PacketReport:
        """Advance to the packet's stamp through all of its events.

        A packet stamped before the previous one starts everything anew; one with the same stamp
        adds its events at that instant.

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
            If an event lies outside of the pixel array or the interval; nothing has changed then.
        """
        self._check(packet)
        restarted = self._stamp_ns is not None and packet.stamp_ns < self._stamp_ns
        if restarted:
            self._reset()
        duration_ns = 0 if self._stamp_ns is None else packet.stamp_ns - self._stamp_ns
        self._stamp_ns = packet.stamp_ns
        lost = 0
        if len(packet.events) == 0:
            self._hold(duration_ns)
        else:
            lost = (int(packet.events['index'][0]) - self._next_index) % INDEX_MODULUS
            self._next_index = (int(packet.events['index'][-1]) + 1) % INDEX_MODULUS
            jumps = self._apply(packet)
            self._hold(duration_ns)
            ages_ns = np.minimum(-packet.events['t'].astype(np.int64), duration_ns)
            self._state = self._state + jumps @ self._response.response(ages_ns * _NANOSECOND_S)
            self._deviation = self._mean_deviation()
        return PacketReport(lost_events=lost, restarted=restarted)

    def _check(self, packet: EventPacket) -> None:
        events = packet.events
        if len(events) == 0:
            return
        if int(events['x'].max()) >= self._width or int(events['y'].max()) >= self._height:
            raise MessageError(
                f'event at x = {events["x"].max()}, y = {events["y"].max()} lies outside of the '
                f'{self._width} x {self._height} pixels'
            )
        if int(events['t'].max()) > 0 or np.any(np.diff(events['t']) < 0):
            raise MessageError("event times must not decrease nor exceed the packet's stamp")
        if np.any(np.abs(events['polarity']) != 1) or np.any(np.abs(events['sign']) != 1):
            raise MessageError('polarity and sign must be +1 or -1')

    def _hold(self, duration_ns: int) -> None:
        """Advance K with the estimate held at its last value."""
        if duration_ns == 0:
            return
        step = self._steps.get(duration_ns)
        if step is None:
            duration_s = duration_ns * _NANOSECOND_S
            step = (
                self._response.transition(duration_s),
                self._response.response(np.array([duration_s]))[0],
            )
            if len(self._steps) < 16:
                self._steps[duration_ns] = step
        transition, gain = step
        self._state = transition @ self._state + gain * self._deviation

    def _apply(self, packet: EventPacket) -> FloatArray:
        """Count the events; return the jump of the mean estimate at each of them, shape (E,)."""
        events = packet.events
        pixels = events['y'].astype(np.intp) * self._width + events['x']
        order = np.argsort(pixels, kind='stable')
        pixel = pixels[order]
        is_first = np.ones(len(pixel), dtype=bool)
        is_first[1:] = pixel[1:] != pixel[:-1]
        running = np.cumsum(events['polarity'][order], dtype=np.int64)
        group = np.cumsum(is_first) - 1
        before_group = np.concatenate(([0], running))[np.flatnonzero(is_first)]
        counts = self.counts[pixel] + running - before_group[group]
        after = (
            events['sign'][order] * self._initial_estimate[pixel] * np.exp(counts * self._log_step)
        )
        before = np.empty_like(after)
        before[1:] = after[:-1]
        before[is_first] = self.estimate[pixel[is_first]]
        is_last = np.ones(len(pixel), dtype=bool)
        is_last[:-1] = is_first[1:]
        self.counts[pixel[is_last]] = counts[is_last]
        self.estimate[pixel[is_last]] = after[is_last]
        jumps: FloatArray = np.empty_like(after)
        jumps[order] = (after - before) / self.estimate.size
        return jumps
