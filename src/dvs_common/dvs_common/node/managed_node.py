"""The base of every node: a lifecycle that starts itself, and the node's health."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from dvs_common.errors import SuiteError
from dvs_common.node.health import Health, Level, Trouble
from dvs_common.node.stream_node import StreamNode
from dvs_common.scenario.scenario import Scenario
from dvs_common.scenario.schema import ParameterSpec
from dvs_common.wire import topics

_DIAGNOSTICS_S = 1.0
_LOOK_S = 0.1
# By itself the middleware asks a reader every 3 s what it misses.
_FAREWELL_S = 3.5
_CLOCK_PATIENCE_S = 2.0
_NO_CLOCK = 'use_sim_time is set, but the time on /clock is still 0: does it have a publisher?'


class ManagedNode(StreamNode):
    """Lifecycle node of the suite: checked parameters, streams, health.

    A subclass implements `configure` and may implement `activate` and `deactivate`, and `change`
    for parameters that change while it is active. What it creates with `advertise`, `subscribe`
    and `every` is destroyed on cleanup.

    Parameters
    ----------
    executable
        Name of the executable, and of the node unless it is remapped.
    own_parameters
        Parameters of an open group of the schema that this node alone has; None if it does not
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
        super().__init__(executable, own_parameters=own_parameters, **node_arguments)
        self.exit_code: int | None = None
        self._lost_reported = 0
        self._configured: Scenario | None = None
        self._guard_transitions()

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

    def health(self) -> Health:
        """State of the node for /diagnostics; asked once a second while it is active."""
        return Health()

    # -- what a subclass uses -------------------------------------------------------------------

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
        self._let_arrive(_FAREWELL_S)
        self._destroy_entities()
        super().destroy_node()

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
        self._open_streams()
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

    def _publish_health(self) -> None:
        health = self.health()
        troubles = list(health.troubles)
        if self.rejected_messages:
            troubles.append(Trouble(level=Level.WARN, message='messages refused'))
        if self.lost_messages > self._lost_reported:
            troubles.append(
                Trouble(level=Level.WARN, message='overload: messages lost before they were taken')
            )
        self._lost_reported = self.lost_messages
        for rivals in self.rivals():
            self.get_logger().error(rivals, throttle_duration_sec=10.0)
            troubles.append(Trouble(level=Level.ERROR, message=rivals))
        if self._clock_stands():
            self.get_logger().warning(_NO_CLOCK, throttle_duration_sec=10.0)
            troubles.append(Trouble(level=Level.WARN, message=_NO_CLOCK))
        health = Health(
            troubles=troubles,
            values={
                **health.values,
                'messages refused': self.rejected_messages,
                'messages lost before they were taken': self.lost_messages,
            },
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

    def _clock_stands(self) -> bool:
        """Whether simulated time has not begun although the node has been active for a while."""
        clock = self.get_clock()
        waited_s = time.monotonic() - self._active_since_s
        begun = not clock.ros_time_is_active or clock.now().nanoseconds > 0
        return not begun and waited_s > _CLOCK_PATIENCE_S

    def _succeeds(self, step: Callable[[], None]) -> bool:
        """Run a transition's work; rclpy would not report what goes wrong in it."""
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
        super()._destroy_entities()
