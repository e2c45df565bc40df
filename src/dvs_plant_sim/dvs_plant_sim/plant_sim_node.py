"""Node `plant_sim`: the simulated plant, sampled by its pixels and driven by `command`."""

from __future__ import annotations

import time

import numpy as np
from dvs_interfaces import topics
from dvs_interfaces.cdr import MessageError
from dvs_interfaces.managed_node import ManagedNode
from dvs_interfaces.messages import Vector, pack_clock, pack_image, pack_state, parse_command
from dvs_interfaces.model import FloatArray
from dvs_interfaces.parameters import PLANT
from dvs_interfaces.scenario import Scenario
from dvs_interfaces.spin import run_nodes
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, JointState

from dvs_plant_sim.pacing import Pace
from dvs_plant_sim.plant import Plant
from dvs_plant_sim.realtime import RealtimePlant

# Wall-clock period after which an unanswered sample is sent again and the missing partner named.
_RESEND_S = 0.5
_PATIENCE_RESENDS = 4
_FAILURE = 1


class PlantSimNode(ManagedNode):
    """Publishes `luminosity`, `state` and `/clock`; takes `command`."""

    def __init__(self, **node_arguments: object) -> None:
        super().__init__(PLANT, **node_arguments)

    def configure(self, scenario: Scenario) -> None:
        """Build the plant and its scene; see `ManagedNode.configure`."""
        self._model = scenario.model
        self._model.require_stabilizable()
        self._model.require_detectable()
        self._scene = scenario.scene
        self._equilibrium = scenario.equilibrium
        self._initial_state = scenario.initial_state
        self._scenario = scenario
        self._period_ns = scenario.sampling_period_ns
        self._last_sample = scenario.sample_count
        self._state_names = tuple(f'x{i + 1}' for i in range(self._model.state_count))
        self._luminosity_publisher = self.advertise(Image, topics.LUMINOSITY, topics.stream_qos())
        self._state_publisher = self.advertise(JointState, topics.STATE, topics.stream_qos())
        qos = topics.handshake_qos(scenario['mode'])
        if scenario['mode'] == 'lockstep':
            self._clock_publisher = self.advertise(Clock, topics.CLOCK, topics.clock_qos())
            self.listen(JointState, topics.COMMAND, self._step, qos)
            self.every(_RESEND_S, self._resend)
            self._due = self.every(1.0, self._publish_due)
        else:
            self.listen(JointState, topics.COMMAND, self._receive, qos)
            self.every(scenario['sampling_period'], self._tick)
        self._say_set_point()

    def activate(self) -> None:
        """Start at the initial state; in lockstep with sample 0."""
        scenario = self._scenario
        self._plant = Plant(
            self._model,
            initial_state=self._initial_state,
            period_ns=self._period_ns,
            input_disturbance=scenario['input_disturbance'],
            state_disturbance=scenario['state_disturbance'],
            seed=scenario['seed'],
        )
        self._nonphysical_samples = 0
        self._sample = 0
        if scenario['mode'] == 'lockstep':
            self._due.cancel()
            self._pace = Pace(scenario['real_time_factor'])
            self._publish_next()
        else:
            self._realtime = RealtimePlant(self._plant)
            self._start_ns = self.get_clock().now().nanoseconds
            self._stale = False

    # -- samples --------------------------------------------------------------------------------

    def _publish_sample(self, stamp_ns: int) -> None:
        luminosity = self._scene.luminosity(self._model, self._plant.state)
        if self._scenario['photoreceptor'] == 'log' and luminosity.min() <= 0:
            luminosity = self._nonphysical(stamp_ns, luminosity)
            if self.exit_code is not None:
                return
        image = luminosity.reshape(self._scene.height, self._scene.width)
        self._message = pack_image(stamp_ns, image, '64FC1')
        state = Vector(stamp_ns=stamp_ns, names=self._state_names, values=self._plant.state)
        self._state_publisher.publish(pack_state(state))
        self._luminosity_publisher.publish(self._message)

    def _nonphysical(self, stamp_ns: int, luminosity: FloatArray) -> FloatArray:
        self._nonphysical_samples += 1
        policy = self._scenario['nonphysical_luminosity']
        pixel = int(luminosity.argmin())
        reason = (
            f'luminosity of pixel {pixel} is {luminosity[pixel]:.6g} <= 0 at {stamp_ns * 1e-9:.6f} s: '
            'a physical pixel has no logarithm of it '
            f'(nonphysical_luminosity: {policy}; photoreceptor: log)'
        )
        if policy == 'stop':
            self.finish(_FAILURE, reason)
        elif self._nonphysical_samples == 1:
            self.get_logger().error(reason)
        if policy == 'clamp':
            return np.maximum(luminosity, self._scenario['dead_band'])
        return luminosity

    def _checked(self, message: bytes) -> Vector:
        command = parse_command(message)
        m = self._model.input_count
        if command.values.size != m or not np.isfinite(command.values).all():
            raise MessageError(f'command {command.values.tolist()} is not {m} finite numbers')
        return command

    # -- lockstep: sample k waits for command k ----------------------------------------------------

    def _publish_next(self) -> None:
        self._resends = 0
        self._answered = False
        stamp_ns = self._sample * self._period_ns
        self._clock_publisher.publish(pack_clock(stamp_ns))
        self._publish_sample(stamp_ns)

    def _step(self, message: bytes) -> None:
        command = self._checked(message)
        awaited_ns = self._sample * self._period_ns
        if command.stamp_ns > awaited_ns:
            raise MessageError(f'command is stamped {command.stamp_ns} ns, awaited {awaited_ns} ns')
        if self._answered or command.stamp_ns < awaited_ns:
            return
        self._answered = True
        if self._last_sample and self._sample == self._last_sample:
            self.finish(0, f'run of {awaited_ns * 1e-9:g} s finished')
            return
        self._plant.advance(self._period_ns, command.values)
        self._sample += 1
        delay_s = self._pace.delay_s(self._sample * self._period_ns, time.monotonic())
        if delay_s:
            self._due.timer_period_ns = int(delay_s * 1e9)
            self._due.reset()
        else:
            self._publish_next()

    def _publish_due(self) -> None:
        self._due.cancel()
        self._publish_next()

    def _resend(self) -> None:
        if self._answered:
            return
        self._resends += 1
        if self._resends > 1:
            self._luminosity_publisher.publish(self._message)
        if self._resends % _PATIENCE_RESENDS == 0:
            self.get_logger().warning(
                f'sample {self._sample} waits for its command: {self._missing_partner()}'
            )

    def _missing_partner(self) -> str:
        if not self._luminosity_publisher.get_subscription_count():
            return 'nobody subscribes to luminosity; is event_camera running?'
        if not self.count_publishers(topics.COMMAND):
            return 'nobody publishes command; is hinf_controller running?'
        return 'camera and controller are there but do not answer'

    # -- realtime: the wall clock goes on -------------------------------------------------------

    def _receive(self, message: bytes) -> None:
        command = self._checked(message)
        self._stale = False
        self._realtime.receive(self.get_clock().now().nanoseconds, command.values)

    def _tick(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        sample = (now_ns - self._start_ns) // self._period_ns
        if sample <= self._sample:
            return
        self._sample = sample
        stamp_ns = self._start_ns + sample * self._period_ns
        self._realtime.advance_to(stamp_ns)
        self._watch_age(now_ns)
        if self.exit_code is None:
            self._publish_sample(stamp_ns)
        if not self._realtime.released:
            self._released_at = sample
        elif self._last_sample and sample - self._released_at >= self._last_sample:
            self.finish(0, f'run of {self._scenario["duration"]:g} s finished')

    def _watch_age(self, now_ns: int) -> None:
        arrival_ns = self._realtime.last_arrival_ns
        if self._stale or arrival_ns is None:
            return
        age_s = (now_ns - arrival_ns) * 1e-9
        if age_s <= self._scenario['command_timeout']:
            return
        self._stale = True
        policy = self._scenario['stale_command']
        reason = f'command is {age_s:.3f} s old (stale_command: {policy})'
        if policy == 'stop':
            self.finish(_FAILURE, reason)
            return
        self.get_logger().warning(reason)
        if policy == 'equilibrium':
            self._realtime.receive(now_ns, self._equilibrium.feedforward)
            self._stale = True

    def _say_set_point(self) -> None:
        if self._equilibrium.residual > 0:
            point = ', '.join(f'{value:.9g}' for value in self._equilibrium.state)
            self.get_logger().info(
                f'the nearest stabilizable set-point is used: [{point}] '
                f'(residual of set_point: {self._equilibrium.residual:.3g})'
            )


def main() -> int:
    """Run the node until a signal or the end of its run."""
    return run_nodes([PlantSimNode])
