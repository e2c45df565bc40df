"""The base of every simulated plant: a subclass moves the state, this does the rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from sensor_msgs.msg import Image, JointState

from dvs_common.arrays import FloatArray
from dvs_common.nanoseconds import as_seconds
from dvs_common.node.direct_calls import raw_sender
from dvs_common.node.health import Health, Level, Trouble
from dvs_common.node.managed_node import ManagedNode
from dvs_common.scenario.brightness_profile import BrightnessProfile
from dvs_common.scenario.parameters import PLANT
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.schema import ParameterSpec
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.messages import Vector, pack_image, pack_state, parse_command
from dvs_plant_sim.disturbance import disturbed
from dvs_plant_sim.driver import Driver
from dvs_plant_sim.dynamics import Dynamics
from dvs_plant_sim.lockstep_driver import LockstepDriver
from dvs_plant_sim.plant import Plant
from dvs_plant_sim.realtime_driver import RealtimeDriver
from dvs_plant_sim.small_step import LARGEST_INPUT, SmallStep

_FAILURE = 1
_STALE_S = 2.0
# Bytes of a command, of any controller: reading millions of names would hold up the plant.
_BYTES_AN_INPUT = 4096
# Of a luminosity image.
_BYTES_A_PIXEL = 8


class PlantNode(ManagedNode):
    """Publishes `luminosity`, `state` and `/clock`; takes `command`.

    A subclass implements `make_plant`, and `luminosity` if its scene is not that of the
    scenario; parameters of its own it lists in `own_parameters`. The node is called `plant_sim`
    whatever its executable, so that tools find it.

    Parameters
    ----------
    **node_arguments
        Further arguments of `rclpy.node.Node`.
    """

    # Parameters of this plant alone; their names begin with PLANT_GROUP.
    own_parameters: ClassVar[Sequence[ParameterSpec]] = ()
    plant: Dynamics

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__(PLANT, own_parameters=self.own_parameters, **node_arguments)

    # -- what a subclass implements -------------------------------------------------------------

    def make_plant(self, scenario: Scenario) -> Dynamics:
        """Return the plant at its initial state; called on configuration and on activation.

        Parameters
        ----------
        scenario
            Checked parameters.

        Raises
        ------
        ParameterError
            If parameters do not fit this plant.
        """
        raise NotImplementedError

    def luminosity(self, state: FloatArray) -> FloatArray:
        """Luminosity of every pixel, shape (r,), row-major; by default that of the scenario.

        This is ``c'(x + dx_i)``, or `brightness_profile` over it.

        Parameters
        ----------
        state
            Plant state x, shape (n,).
        """
        return self._scene.luminosity(self._model, state)

    # -- lifecycle ------------------------------------------------------------------------------

    def configure(self, scenario: Scenario) -> None:
        """Build the plant and its scene; see `ManagedNode.configure`."""
        self._scenario = scenario
        self._model = scenario.model
        self._input_names = tuple(f'u{i + 1}' for i in range(self._model.input_count))
        self._model.require_stabilizable()
        self._model.require_detectable()
        self._scene = scenario.scene
        pixels = self._scene.pixel_count
        self._state_names = tuple(f'x{i + 1}' for i in range(self._model.state_count))
        self.plant = disturbed(self.make_plant(scenario), scenario)
        self._luminosity_publisher = self.advertise(
            Image,
            topics.LUMINOSITY,
            topics.stream_qos(topics.history_depth(_BYTES_A_PIXEL * pixels)),
        )
        self._send_luminosity = raw_sender(self._luminosity_publisher)
        for topic in (topics.LUMINOSITY, topics.COMMAND):
            self.expect_one_publisher(topic)
        self._state_publisher = self.advertise_on_demand(
            JointState, topics.STATE, topics.stream_qos(topics.LISTENER_DEPTH)
        )
        driver = LockstepDriver if scenario.loop.mode == 'lockstep' else RealtimeDriver
        self._driver: Driver = driver(self, scenario)
        self._log_set_point()

    def activate(self) -> None:
        """Start at the initial state; in lockstep with sample 0."""
        self.plant = disturbed(self.make_plant(self._scenario), self._scenario)
        self._nonphysical_samples = self._samples_beyond = 0
        self._driver.start()

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Change pace, set-point or tolerance; see `ManagedNode.change`."""
        scenario.equilibrium  # noqa: B018 -- refuses a set-point that can't be held
        return lambda: self._adopt(scenario)

    def _adopt(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._driver.adopt(scenario)

    def health(self) -> Health:
        """Speed, age of the command, luminosity; see `ManagedNode.health`."""
        troubles = list(self._driver.troubles())
        if self._nonphysical_samples:
            troubles.append(Trouble(level=Level.ERROR, message='luminosity <= 0'))
        if self._samples_beyond:
            troubles.append(Trouble(level=Level.WARN, message='brightness profile left'))
        if self.silence_s(topics.COMMAND) > _STALE_S:
            troubles.append(Trouble(level=Level.STALE, message='no command arrives'))
        return Health(
            troubles=troubles,
            values={
                **self._driver.figures(),
                'age of command [s]': f'{self.silence_s(topics.COMMAND):.3f}',
                'samples with luminosity <= 0': self._nonphysical_samples,
                'samples beyond the brightness profile': self._samples_beyond,
            },
        )

    # -- what the drivers use -------------------------------------------------------------------

    def publish_sample(self, stamp_ns: int) -> None:
        """Publish state and luminosity of this instant.

        Parameters
        ----------
        stamp_ns
            Time of the sample, ns.
        """
        disturbance = self._scenario.disturbance.output_disturbance
        state = self.plant.state
        luminosity = self.luminosity(state) + disturbance
        darkest, brightest = float(luminosity.min()), float(luminosity.max())
        # NaN is not less than anything; a state may be one that no pixel sees.
        if not (-math.inf < darkest and brightest < math.inf and math.isfinite(np.sum(state))):
            self.finish(_FAILURE, f'the state has left the range of numbers: {state}')
            return
        if darkest <= 0 and self._scenario.sensor.photoreceptor == 'log':
            luminosity = self._nonphysical(stamp_ns, luminosity)
            if self.exit_code is not None:
                return
        if self._scene.profile is not None:
            self._watch_profile(stamp_ns, self._scene.profile)
        image = luminosity.reshape(self._scene.height, self._scene.width)
        self.publish_image(pack_image(stamp_ns, image, '64FC1'), stamp_ns)

    def publish_image(self, image: bytes, stamp_ns: int) -> None:
        """Publish what the pixels see of the present state, and the state.

        Parameters
        ----------
        image
            CDR bytes.
        stamp_ns
            Time of the sample, ns.
        """
        self._message = image
        # First what the loop waits for, then what others look at.
        self._send_luminosity(image)
        if self._state_publisher.wanted:
            state = self.plant.state
            vector = Vector(stamp_ns=stamp_ns, names=self._state_names, values=state)
            self._state_publisher.publish(pack_state(vector))

    def small_step(self) -> SmallStep | None:
        """The fast path from a command to the next image; None where there is none."""
        # Subclasses may move, and see, in ways of their own.
        plant, sees_plainly = self.plant, type(self).luminosity is PlantNode.luminosity
        if type(plant) is not Plant or not sees_plainly:
            return None
        if not SmallStep.fits(self._model, self._scene):
            return None
        return SmallStep(
            plant,
            self._model,
            self._scene,
            input_names=self._input_names,
            output_disturbance=self._scenario.disturbance.output_disturbance,
            needs_light=self._scenario.sensor.photoreceptor == 'log',
        )

    def send_again(self) -> None:
        """Publish the last luminosity once more."""
        self._send_luminosity(self._message)

    def checked_command(self, message: bytes) -> Vector:
        """Command of a serialized sensor_msgs/JointState.

        Parameters
        ----------
        message
            CDR bytes.

        Raises
        ------
        MessageError
            If it does not hold m finite numbers under the names u1 to um, in any order.
        """
        names = self._input_names
        if len(message) > _BYTES_AN_INPUT * (1 + len(names)):
            raise MessageError(f'command of {len(message)} bytes for {len(names)} inputs')
        command = parse_command(message)
        values = command.values.tolist()
        # NaN is not less than anything.
        if len(values) != len(names) or not all(abs(u) < LARGEST_INPUT for u in values):
            raise MessageError(
                f'command {values} is not {len(names)} finite numbers below {LARGEST_INPUT:g}'
            )
        if command.names != names:
            raise MessageError(
                f'command has the names {", ".join(command.names)}, must have {", ".join(names)}'
            )
        return command

    def missing_partner(self) -> str:
        """Why no command comes, in words."""
        if not self._luminosity_publisher.get_subscription_count():
            return 'luminosity has no subscriber; is event_camera running?'
        if not self.count_publishers(topics.COMMAND):
            return 'command has no publisher; is hinf_controller running?'
        return 'camera and controller are there but do not answer'

    # -- details --------------------------------------------------------------------------------

    def _watch_profile(self, stamp_ns: int, profile: BrightnessProfile) -> None:
        if profile.covers(self._scene.positions(self._model, self.plant.state)):
            return
        self._samples_beyond += 1
        if self._samples_beyond == 1:
            self.get_logger().error(
                f'a pixel is beyond brightness_profile at {as_seconds(stamp_ns):.6f} s: it sees '
                'the luminosity of its end'
            )

    def _nonphysical(self, stamp_ns: int, luminosity: FloatArray) -> FloatArray:
        self._nonphysical_samples += 1
        policy = self._scenario.loop.nonphysical_luminosity
        pixel = int(luminosity.argmin())
        reason = (
            f'luminosity of pixel {pixel} is {luminosity[pixel]:.6g} <= 0 at '
            f'{as_seconds(stamp_ns):.6f} s: a physical pixel has no logarithm of it '
            f'(nonphysical_luminosity: {policy}; photoreceptor: log)'
        )
        if policy == 'stop':
            self.finish(_FAILURE, reason)
        elif self._nonphysical_samples == 1:
            self.get_logger().error(reason)
        if policy == 'clamp':
            floor: float = self._scenario.sensor.dead_band
            return np.maximum(luminosity, floor)
        return luminosity

    def _log_set_point(self) -> None:
        equilibrium = self._scenario.equilibrium
        if equilibrium.residual > 0:
            point = ', '.join(f'{value:.9g}' for value in equilibrium.state)
            self.get_logger().info(
                f'the nearest stabilizable set-point is used: [{point}] '
                f'(residual of set_point: {equilibrium.residual:.3g})'
            )
