"""The half of a plant node that runs in lockstep: simulated time, one sample at a time."""

from __future__ import annotations

import time

from rclpy.qos import DurabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from dvs_common.nanoseconds import as_nanoseconds, as_seconds
from dvs_common.node.health import RateMeter, Trouble
from dvs_common.scenario.scenario import Scenario
from dvs_common.wire import topics
from dvs_common.wire.messages import pack_clock
from dvs_plant_sim.driver import SampledPlant
from dvs_plant_sim.handshake import Handshake
from dvs_plant_sim.pacing import Pace

# Wall-clock period of the waiting turns of an unanswered sample.
_RESEND_S = 0.5
# Turns after which, again and again, the missing partner is named.
_PATIENCE_TURNS = 4
# The first sample waits until a controller is met, so that its answer is not lost. One that was
# there before sends its last command again to a late subscriber: it belongs to an earlier run.
_MEETING_TURN_S = 0.05
_QUIET_TURNS = 4
_TURNS_ALONE = 20
_LONGEST_MEETING_TURNS = 100
# However small the real_time_factor: a timer can't be set to any time.
_LONGEST_PAUSE_S = 3600.0


class LockstepDriver:
    """Publishes sample k and `/clock`, waits for command k, advances the plant.

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
        self._clock_publisher = node.advertise_on_demand(Clock, topics.CLOCK, topics.clock_qos())
        # A controller latches the commands of this plant's earlier run: they must not come here.
        qos = topics.handshake_qos(scenario.loop.mode)
        qos.durability = DurabilityPolicy.VOLATILE
        node.subscribe(JointState, topics.COMMAND, self._step, qos)
        node.every(_RESEND_S, self._wait)
        self._due = node.every(1.0, self._publish_due)
        self._meeting = node.every(_MEETING_TURN_S, self._meet)

    def start(self) -> None:
        """Publish sample 0 once a controller is met and no command of an earlier run comes."""
        scenario = self._scenario
        self._due.cancel()
        self._meeting.reset()
        self._turns = self._quiet_turns = 0
        self._handshake = Handshake(period_ns=self._period_ns, last_sample=scenario.sample_count)
        self._pace = Pace(scenario.loop.real_time_factor)
        self._cycle_rate = RateMeter()
        self._small = self._node.small_step()

    def _meet(self) -> None:
        """Let a turn of the meeting pass; it ends without a controller too, after a while."""
        self._turns += 1
        is_met = self._node.count_publishers(topics.COMMAND) > 0
        self._quiet_turns += is_met
        patience = _LONGEST_MEETING_TURNS if is_met else _TURNS_ALONE
        if self._quiet_turns >= _QUIET_TURNS or self._turns >= patience:
            self._meeting.cancel()
            self._publish()

    def _publish(self) -> None:
        stamp_ns = self._handshake.stamp_ns
        self._handshake.sent()
        self._node.publish_sample(stamp_ns)
        self._await_command(stamp_ns)

    def _await_command(self, stamp_ns: int) -> None:
        if self._clock_publisher.wanted:
            self._clock_publisher.publish(pack_clock(stamp_ns))
        handshake = self._handshake
        is_usual = handshake.sample > 0 and not handshake.is_last and self._pace.is_free
        if self._small is not None and is_usual:
            self._small.prepare(stamp_ns)

    def _step_small(self, message: bytes) -> bool:
        """Take the fast path to the next sample; return whether there was one."""
        image = None if self._small is None else self._small.image_after(message)
        if image is None:
            return False
        handshake = self._handshake
        handshake.accepts(handshake.stamp_ns)
        stamp_ns = handshake.next()
        handshake.sent()
        self._node.publish_image(image, stamp_ns)
        self._await_command(stamp_ns)
        return True

    def _step(self, message: bytes) -> None:
        if self._step_small(message):
            return
        command = self._node.checked_command(message)
        if not self._handshake.accepts(command.stamp_ns):
            # While they meet: a command of an earlier run.
            self._quiet_turns = 0
            return
        if self._handshake.sample == 0:
            self._first_answer_s = time.perf_counter()
        if self._handshake.is_last:
            self._finish(command.stamp_ns)
            return
        self._node.plant.advance(self._period_ns, command.values)
        delay_s = self._pace.delay_s(self._handshake.next(), time.monotonic())
        if delay_s:
            self._due.timer_period_ns = as_nanoseconds(min(delay_s, _LONGEST_PAUSE_S))
            self._due.reset()
        else:
            self._publish()

    def _finish(self, stamp_ns: int) -> None:
        wall_s = time.perf_counter() - self._first_answer_s
        cycles = self._handshake.sample
        self._node.finish(
            0,
            f'run of {as_seconds(stamp_ns):g} s finished: {cycles} cycles in {wall_s:.3f} s, '
            f'{cycles / wall_s:.0f} cycles/s',
        )

    def adopt(self, scenario: Scenario) -> None:
        """Take over changed parameters.

        Parameters
        ----------
        scenario
            Checked parameters.
        """
        self._scenario = scenario
        self._pace.change(scenario.loop.real_time_factor)
        if not self._due.is_canceled():
            self._publish_due()

    def troubles(self) -> list[Trouble]:
        """What is wrong with the handshake: nothing that the age of the command does not show."""
        return []

    def figures(self) -> dict[str, object]:
        """Speed of the run since the last reading."""
        cycles = self._cycle_rate.read(self._handshake.sample)
        return {
            'simulated time [s]': f'{as_seconds(self._handshake.stamp_ns):.6f}',
            'cycles/s': f'{cycles:.1f}',
            'real-time factor': f'{cycles * self._scenario.loop.sampling_period:.3f}',
        }

    def _publish_due(self) -> None:
        self._due.cancel()
        self._publish()

    def _wait(self) -> None:
        turns = self._handshake.wait()
        if turns > 1:
            self._node.send_again()
        if turns and turns % _PATIENCE_TURNS == 0:
            self._node.get_logger().warning(
                f'sample {self._handshake.sample} waits for its command: '
                f'{self._node.missing_partner()}'
            )
