"""The half of a plant node that runs on the wall clock, which does not wait."""

from __future__ import annotations

import time

from sensor_msgs.msg import JointState

from dvs_common.nanoseconds import as_seconds
from dvs_common.node.health import Level, RateMeter, Trouble
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_plant_sim.driver import SampledPlant
from dvs_plant_sim.realtime import RealtimePlant

_FAILURE = 1
# A machine that stalls lets a plant run on; beyond this it is no run.
_LONGEST_STALL_S = 10.0
# What the clock may gain on the time that passes, with a simulated clock that runs fast.
_MOST_GAIN_S, _MOST_GAIN = 1.0, 10.0


class RealtimeDriver:
    """Samples the plant on a timer and holds the last command that has arrived.

    Parameters
    ----------
    node
        Node that is being configured.
    scenario
        Checked parameters.
    """

    def __init__(self, node: SampledPlant, scenario: Scenario) -> None:
        self._node = node
        self._scenario = scenario
        self._period_ns = scenario.sampling_period_ns
        self._last_sample = scenario.sample_count
        self._hold_input = scenario.equilibrium.feedforward
        qos = topics.handshake_qos(scenario.loop.mode)
        node.subscribe(JointState, topics.COMMAND, self._receive, qos)
        self._timer = node.every(scenario.loop.sampling_period, self._tick)

    def start(self) -> None:
        """Count samples from now on."""
        self._plant = RealtimePlant(self._node.plant)
        self._start_ns = self._last_ns = self._now_ns()
        # So that the timer calls just after samples are due, and not at any time between two.
        self._timer.reset()
        self._last_wall_s = time.monotonic()
        self._sample = self._released_at = 0
        self._stale = False
        self._samples = self._skipped = self._skipped_reported = self._worst_delay_ns = 0
        self._sample_rate = RateMeter()

    def adopt(self, scenario: Scenario) -> None:
        """Take over changed parameters.

        Parameters
        ----------
        scenario
            Checked parameters.
        """
        self._scenario = scenario
        self._hold_input = scenario.equilibrium.feedforward

    def troubles(self) -> list[Trouble]:
        """A stale command, or samples that the machine was too slow for since the last reading."""
        troubles = []
        if self._stale:
            troubles.append(Trouble(level=Level.WARN, message='command is stale'))
        if self._skipped > self._skipped_reported:
            troubles.append(Trouble(level=Level.WARN, message='samples skipped'))
        self._skipped_reported = self._skipped
        return troubles

    def figures(self) -> dict[str, object]:
        """Rate and jitter of the samples since the last reading."""
        rate = self._sample_rate.read(self._samples)
        worst_ns, self._worst_delay_ns = self._worst_delay_ns, 0
        return {
            'samples/s': f'{rate:.1f}',
            'real-time factor': f'{rate * as_seconds(self._period_ns):.3f}',
            'samples skipped': self._skipped,
            'worst sampling jitter [ms]': f'{worst_ns * 1e-6:.3f}',
        }

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _receive(self, message: bytes) -> None:
        command = self._node.checked_command(message)
        self._stale = False
        self._plant.receive(self._now_ns(), command.values)

    def _tick(self) -> None:
        now_ns = self._now_ns()
        if now_ns and not self._start_ns:
            # A simulated clock that stood at 0 until now.
            self._node.activate()
            return
        step = self._clock_step(now_ns)
        if step:
            self._node.get_logger().warning(f'{step}: the plant starts again')
            self._node.activate()
            return
        sample = (now_ns - self._start_ns) // self._period_ns
        if sample == self._sample:
            return
        self._skipped += sample - self._sample - 1
        self._samples += 1
        self._sample = sample
        stamp_ns = self._start_ns + sample * self._period_ns
        self._worst_delay_ns = max(self._worst_delay_ns, now_ns - stamp_ns)
        self._plant.advance_to(stamp_ns)
        self._watch_age(now_ns)
        if self._node.exit_code is None:
            self._node.publish_sample(stamp_ns)
        if not self._plant.released:
            self._released_at = sample
        elif self._last_sample and sample - self._released_at >= self._last_sample:
            self._node.finish(0, f'run of {self._scenario.loop.duration:g} s finished')

    def _clock_step(self, now_ns: int) -> str:
        """What the clock did since the last turn, if that was no passing of time."""
        wall_s = time.monotonic()
        passed_s = wall_s - self._last_wall_s
        gained_s = as_seconds(now_ns - self._last_ns)
        self._last_ns, self._last_wall_s = now_ns, wall_s
        if now_ns < self._start_ns + self._sample * self._period_ns:
            return 'the clock went back'
        if gained_s > min(_LONGEST_STALL_S, _MOST_GAIN_S + _MOST_GAIN * passed_s):
            return f'the clock went forward by {gained_s:.3f} s while {passed_s:.3f} s passed'
        return ''

    def _watch_age(self, now_ns: int) -> None:
        arrival_ns = self._plant.last_arrival_ns
        if self._stale or arrival_ns is None:
            return
        age_s = as_seconds(now_ns - arrival_ns)
        if age_s <= self._scenario.loop.command_timeout:
            return
        self._stale = True
        policy = self._scenario.loop.stale_command
        reason = f'command is {age_s:.3f} s old (stale_command: {policy})'
        if policy == 'stop':
            self._node.finish(_FAILURE, reason)
            return
        self._node.get_logger().warning(reason)
        if policy == 'equilibrium':
            self._plant.receive(now_ns, self._hold_input)
