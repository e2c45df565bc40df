"""The base of every node: lifecycle, checked parameters, and handlers that survive any message."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.timer import Timer

from dvs_common.errors import SuiteError
from dvs_common.nanoseconds import as_nanoseconds
from dvs_common.node.demanded_publisher import DemandedPublisher
from dvs_common.node.health import Health, Level, Trouble
from dvs_common.node.ros_parameters import ROS_TYPE, descriptor, plain
from dvs_common.node.token_publisher import TokenPublisher
from dvs_common.scenario.parameters import SCHEMA
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.schema import ParameterSpec, Value, is_ros_parameter
from dvs_common.wire import topics
from dvs_common.wire.cdr import MessageError

_DIAGNOSTICS_S = 1.0
_LOOK_S = 0.1
# The middleware asks a reader every 3 s what it misses.
_FAREWELL_S = 3.5


class ManagedNode(LifecycleNode):
    """Lifecycle node whose parameters are those of the suite's schema.

    A subclass implements `configure` and may implement `activate` and `deactivate`. What it
    creates with `advertise`, `listen` and `every` is destroyed on cleanup.

    Parameters
    ----------
    executable
        Name of the executable, and of the node unless it is remapped.
    own_parameters
        Parameters of an open group of the schema that this node alone knows; None if it does not
        own the group.
    **node_arguments
        Further arguments of `rclpy.node.Node`.

    Raises
    ------
    ParameterError
        If a parameter's name is unknown or its value breaks its rule.
    """

    def __init__(
        self,
        executable: str,
        *,
        own_parameters: Sequence[ParameterSpec] | None = None,
        **node_arguments: Any,
    ) -> None:
        super().__init__(
            executable, automatically_declare_parameters_from_overrides=True, **node_arguments
        )
        self.exit_code: int | None = None
        self.rejected_messages = 0
        self.is_active = False
        self._heard_s: dict[str, float] = {}
        self._active_since_s = 0.0
        self._accepted_change: Callable[[], None] | None = None
        self._configured: Scenario | None = None
        self._entities: list[tuple[Callable[[Any], object], Any]] = []
        self._looking: list[DemandedPublisher | TokenPublisher] = []
        self._schema = SCHEMA if own_parameters is None else SCHEMA.closed(own_parameters)
        self._specs = [*SCHEMA.of_node(executable), *(own_parameters or ())]
        # Timers follow the wall clock, even where use_sim_time ties the node's clock to /clock.
        self._wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._guard_transitions()
        self._foreign = self._declare_parameters()
        self.add_on_set_parameters_callback(self._check_change)
        self.add_post_set_parameters_callback(self._make_change)

    # -- what a subclass implements -------------------------------------------------------------

    def configure(self, scenario: Scenario) -> None:
        """Check the scenario, build the core and create publishers and subscriptions.

        Parameters
        ----------
        scenario
            All parameters, checked one by one.

        Raises
        ------
        ParameterError
            If parameters do not fit together.
        """
        raise NotImplementedError

    def activate(self) -> None:
        """Begin to act; called on activation."""

    def deactivate(self) -> None:
        """Stop acting and leave everything safe; called on deactivation."""

    def change(self, scenario: Scenario) -> Callable[[], None]:
        """Prepare a change of dynamic parameters while the node is active.

        Parameters
        ----------
        scenario
            All parameters with the change in them.

        Returns
        -------
        Callable
            Makes the change; called only if it is accepted.

        Raises
        ------
        SuiteError
            If the change can't be; nothing has changed then.
        """
        return lambda: None

    def health(self) -> Health:
        """State of the node for /diagnostics; asked once a second while it is active."""
        return Health()

    # -- what a subclass uses -------------------------------------------------------------------

    def advertise(self, message_type: type, topic: str, qos: QoSProfile) -> Publisher:
        """Publisher that cleanup destroys; takes serialized messages too.

        Parameters
        ----------
        message_type
            Class of the messages.
        topic
            Relative or absolute name.
        qos
            Quality of service.
        """
        publisher = self.create_publisher(message_type, topic, qos)
        self._entities.append((self.destroy_publisher, publisher))
        return publisher

    def advertise_on_demand(
        self, message_type: type, topic: str, qos: QoSProfile
    ) -> DemandedPublisher:
        """Publisher that knows whether it has subscribers; see `advertise`.

        Parameters
        ----------
        message_type
            Class of the messages.
        topic
            Relative or absolute name.
        qos
            Quality of service.
        """
        publisher = DemandedPublisher(self.advertise(message_type, topic, qos))
        self._looking.append(publisher)
        return publisher

    def advertise_token(
        self, message_type: type, topic: str, qos: QoSProfile
    ) -> Publisher | TokenPublisher:
        """Publisher of what a lockstep partner waits for, in realtime just `advertise`.

        Parameters
        ----------
        message_type
            Class of the messages.
        topic
            Relative or absolute name.
        qos
            Quality of service; latched in lockstep.
        """
        publisher = self.advertise(message_type, topic, qos)
        if qos.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return publisher
        token = TokenPublisher(self, publisher)
        self._looking.append(token)
        return token

    def listen(
        self, message_type: type, topic: str, handler: Callable[[bytes], None], qos: QoSProfile
    ) -> None:
        """Subscribe to serialized messages; only an active node receives them.

        A message that `handler` refuses with `MessageError` is counted and reported, once at
        first and then at most every five seconds; it never ends the node. Nor does a defect in
        `handler`, which is reported with its traceback.

        Parameters
        ----------
        message_type
            Class of the messages.
        topic
            Relative or absolute name.
        handler
            Called with the CDR bytes of each message.
        qos
            Quality of service.
        """

        def guarded(message: bytes) -> None:
            if not self.is_active:
                return
            self._heard_s[topic] = time.monotonic()
            try:
                handler(message)
            except MessageError as error:
                self._reject(topic, str(error))
            except Exception:
                self._reject(topic, f'unexpected error:\n{traceback.format_exc()}')

        subscription = self.create_subscription(message_type, topic, guarded, qos, raw=True)
        self._entities.append((self.destroy_subscription, subscription))

    def _reject(self, topic: str, reason: str) -> None:
        self.rejected_messages += 1
        self.get_logger().error(
            f'message on {topic} refused ({self.rejected_messages} so far): {reason}',
            throttle_duration_sec=5.0,
        )

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Wall-clock timer that cleanup destroys; it only calls back while the node is active.

        Parameters
        ----------
        period_s
            Period, s.
        callback
            Called without arguments.
        """

        def guarded() -> None:
            if self.is_active:
                callback()

        timer = self.create_timer(period_s, guarded, clock=self._wall_clock)
        self._entities.append((self.destroy_timer, timer))
        return timer

    def silence_s(self, topic: str) -> float:
        """Wall-clock time since the last message on `topic`, or since activation, s.

        Parameters
        ----------
        topic
            Topic given to `listen`.
        """
        return time.monotonic() - self._heard_s.get(topic, self._active_since_s)

    def finish(self, exit_code: int, reason: str) -> None:
        """End the process after the current callback.

        Parameters
        ----------
        exit_code
            Exit code of the process; 0 is a success.
        reason
            One sentence for the log.
        """
        if self.exit_code is not None:
            return
        self.exit_code = exit_code
        if exit_code:
            self.get_logger().fatal(reason)
        else:
            self.get_logger().info(reason)

    def destroy_node(self) -> None:
        """Stop safely from whatever state, let readers get what was published, and go."""
        self._stop_acting()
        deadline_s = time.monotonic() + _FAREWELL_S
        for _, entity in self._entities:
            if isinstance(entity, Publisher):
                left_s = max(0.0, deadline_s - time.monotonic())
                entity.wait_for_all_acked(Duration(nanoseconds=as_nanoseconds(left_s)))
        self._destroy_entities()
        super().destroy_node()

    @property
    def autostart(self) -> bool:
        """Whether the node configures and activates by itself."""
        return bool(self.get_parameter('autostart').value)

    def is_given(self, name: str) -> bool:
        """Whether a parameter of other nodes came with this node's, as in a scenario's file.

        Parameters
        ----------
        name
            Parameter that this node does not have itself.
        """
        return name in self._foreign

    def scenario(self) -> Scenario:
        """Return the scenario of the current parameter values.

        Raises
        ------
        ParameterError
            If a value breaks its rule.
        """
        own = {spec.name: plain(self.get_parameter(spec.name).value) for spec in self._specs}
        return Scenario.from_values({**self._foreign, **own})

    # -- lifecycle ------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave `state`: configure, or report in one message what does not fit."""
        if not self._succeeds(lambda: self._configure(self.scenario())):
            self._destroy_entities()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave `state`: open the valves, after a configuration for what has been set since."""
        if not self._succeeds(self._keep_up):
            self._destroy_entities()
            return TransitionCallbackReturn.FAILURE
        self.is_active = True
        self._active_since_s = time.monotonic()
        self._heard_s.clear()
        self._look()
        if not self._succeeds(self.activate):
            self.is_active = False
            return TransitionCallbackReturn.FAILURE
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave `state`: close the valves."""
        self._stop_acting()
        # What comes while the node is inactive is not received: new subscriptions get it again.
        self._configured = None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave `state`: free what configure made."""
        self._destroy_entities()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave `state`, whatever it is: stop safely."""
        self._stop_acting()
        self._destroy_entities()
        return super().on_shutdown(state)

    def _guard_transitions(self) -> None:
        """Answer a request for a transition that is not possible; rclpy raises an error."""
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = self._guarded_transition(service.callback)

    def _guarded_transition(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def guarded(request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except RuntimeError as error:
                asked = request.transition.label or request.transition.id
                self.get_logger().error(f'transition {asked} refused: {error}')
                response.success = False
                return response

        return guarded

    def _keep_up(self) -> None:
        scenario = self.scenario()
        if self._configured is None or scenario.values != self._configured.values:
            self._destroy_entities()
            self._configure(scenario)

    def _configure(self, scenario: Scenario) -> None:
        self.configure(scenario)
        self._configured = scenario
        self._diagnostics = self.advertise(
            DiagnosticArray, topics.DIAGNOSTICS, topics.stream_qos()
        )
        self.every(_DIAGNOSTICS_S, self._publish_health)
        self.every(_LOOK_S, self._look)

    def _look(self) -> None:
        for publisher in self._looking:
            publisher.look()

    def _publish_health(self) -> None:
        health = self.health()
        troubles = list(health.troubles)
        if self.rejected_messages:
            troubles.append(Trouble(level=Level.WARN, message='messages refused'))
        health = Health(
            troubles=troubles, values={**health.values, 'messages refused': self.rejected_messages}
        )
        status = DiagnosticStatus(
            level=bytes([health.level]),
            name=self.get_fully_qualified_name()[1:],
            message=health.message,
            values=[KeyValue(key=key, value=str(value)) for key, value in health.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _succeeds(self, step: Callable[[], None]) -> bool:
        """Run a transition's work; rclpy would swallow what goes wrong in it."""
        try:
            step()
        except SuiteError as error:
            self.get_logger().fatal(str(error))
            return False
        except Exception:
            self.get_logger().fatal(f'unexpected error:\n{traceback.format_exc()}')
            return False
        return True

    def _stop_acting(self) -> None:
        if self.is_active:
            self._succeeds(self.deactivate)
            self.is_active = False

    def _destroy_entities(self) -> None:
        self._configured = None
        self._looking.clear()
        while self._entities:
            destroy, entity = self._entities.pop()
            destroy(entity)

    # -- parameters -----------------------------------------------------------------------------

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """Declare parameters; an empty list in a parameter file comes as None, without a type.

        Parameters
        ----------
        namespace
            Prefix of the names.
        parameters
            Name, value and descriptor of each.
        ignore_override
            Whether the values count and not those that the node was started with.

        Returns
        -------
        list of Parameter
            The declared parameters.
        """
        typed = [
            (name, value, ParameterDescriptor(dynamic_typing=True), *rest[1:])
            if value is None
            else (name, value, *rest)
            for name, value, *rest in parameters
        ]
        declared: list[Parameter] = super().declare_parameters(namespace, typed, ignore_override)
        return declared

    def _declare_parameters(self) -> dict[str, Value]:
        """Declare this node's parameters; return the checked values of other nodes' ones."""
        overrides = {
            name: parameter.value
            for name, parameter in self.get_parameters_by_prefix('').items()
            if not is_ros_parameter(name)
        }
        for name in overrides:
            self.undeclare_parameter(name)
        overrides = {name: plain(value) for name, value in overrides.items()}
        values = self._schema.validate(overrides)
        for spec in self._specs:
            self._declare(spec, values[spec.name])
        own = {spec.name for spec in self._specs}
        return {name: values[name] for name in overrides if name not in own}

    def _declare(self, spec: ParameterSpec, value: Value) -> None:
        """Declare a parameter; of an empty list rclpy has to be told the type."""
        kind = ROS_TYPE[spec.kind]
        empty = value == ()
        self.declare_parameter(
            spec.name, kind if empty else value, descriptor(spec), ignore_override=True
        )
        if empty:
            # Unset, it would keep `ros2 param dump` and rqt from seeing any of the others.
            self.set_parameters([Parameter(spec.name, kind, [])])

    def _check_change(self, parameters: list[Parameter]) -> SetParametersResult:
        specs = {spec.name: spec for spec in self._specs}
        changes = {p.name: plain(p.value) for p in parameters if p.name in specs}
        fixed = [name for name in changes if self.is_active and not specs[name].dynamic]
        if fixed:
            return SetParametersResult(
                successful=False,
                reason=f'{", ".join(fixed)} can only change while the node is not active',
            )
        try:
            for name, value in changes.items():
                specs[name].validate(value)
            if self.is_active and changes:
                self._accepted_change = self.change(self.scenario().replace(**changes))
        except SuiteError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _make_change(self, parameters: list[Parameter]) -> None:
        change, self._accepted_change = self._accepted_change, None
        if change is not None:
            change()
