"""A node whose publishers, subscriptions and timers come and go with its configuration."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from dvs_common.nanoseconds import as_nanoseconds
from dvs_common.node.demanded_publisher import DemandedPublisher
from dvs_common.node.direct_calls import AnyPublisher, DirectCalls, DirectPublisher
from dvs_common.node.fitting_subscription import FittingSubscription
from dvs_common.node.message_information import Arrivals, WithInformation, publication_ns
from dvs_common.node.parameter_node import ParameterNode
from dvs_common.node.sole_publisher import SolePublisher
from dvs_common.node.token_publisher import TokenPublisher
from dvs_common.scenario.schema import ParameterSpec
from dvs_common.wire.cdr import MessageError


class StreamNode(ParameterNode):
    """Node whose handlers survive any message and are called only while it is active.

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
        self.rejected_messages = 0
        self.lost_messages = 0
        # When the message that is handled now was published, by the clock of its publisher.
        self.published_ns: int | None = None
        # To the other nodes of this process, if there are some.
        self.direct: DirectCalls | None = None
        self._sole: list[SolePublisher] = []
        self._received_s: dict[str, float] = {}
        self._active_since_s = 0.0
        self._entities: list[tuple[Callable[[Any], object], Any]] = []
        self._looking: list[DemandedPublisher | TokenPublisher] = []
        self._fitting: list[FittingSubscription] = []
        # Timers follow the wall clock, even where use_sim_time ties the node's clock to /clock.
        self._wall_clock = Clock(clock_type=ClockType.STEADY_TIME)

    def advertise(self, message_type: type, topic: str, qos: QoSProfile) -> AnyPublisher:
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
        if self.direct is not None:
            publisher = self.direct.publisher(publisher, qos)
        self._entities.append((self._retract, publisher))
        return publisher

    def _retract(self, publisher: AnyPublisher) -> None:
        if isinstance(publisher, DirectPublisher):
            assert self.direct is not None
            self.direct.retract(publisher)
            publisher = publisher.publisher
        self.destroy_publisher(publisher)

    def advertise_on_demand(
        self, message_type: type, topic: str, qos: QoSProfile
    ) -> DemandedPublisher:
        """Publisher that reports whether it has subscribers; see `advertise`.

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

    def advertise_token(self, message_type: type, topic: str, qos: QoSProfile) -> TokenPublisher:
        """Publisher of what a lockstep partner waits for; in realtime there is none.

        Parameters
        ----------
        message_type
            Class of the messages.
        topic
            Relative or absolute name.
        qos
            Quality of service; latched in lockstep.
        """

        def renewed(publisher: AnyPublisher) -> AnyPublisher:
            self._entities.remove((self._retract, publisher))
            self._retract(publisher)
            return self.advertise(message_type, topic, qos)

        token = TokenPublisher(self, self.advertise(message_type, topic, qos), renewed)
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._looking.append(token)
        return token

    def subscribe(
        self, message_type: type, topic: str, handler: Callable[[bytes], None], qos: QoSProfile
    ) -> None:
        """Subscribe to serialized messages; only an active node receives them.

        Where publishers offer less than `qos`, it asks for no more than that, with a warning.

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
        arrivals = Arrivals()

        def guarded(message: bytes) -> None:
            if not self.is_active:
                return
            self._received_s[topic] = time.monotonic()
            try:
                handler(message)
            except MessageError as error:
                self._reject(topic, str(error))
            except Exception:
                self._reject(topic, f'unexpected error:\n{traceback.format_exc()}')

        def counted(message: bytes, information: Mapping[str, Any]) -> None:
            missed = arrivals.missed_before(information)
            # The numbers of several publishers have nothing to do with each other.
            if missed and self.is_active and fitting.subscription.get_publisher_count() == 1:
                self.lost_messages += missed
            self.published_ns = publication_ns(information)
            guarded(message)
            self.published_ns = None

        def create(qos: QoSProfile) -> Subscription[Any]:
            return self.create_subscription(
                message_type, topic, WithInformation(counted), qos, raw=True
            )

        fitting = FittingSubscription(self, create, qos)
        self._fitting.append(fitting)
        self._entities.append((lambda own: self.destroy_subscription(own.subscription), fitting))
        if direct := self.direct:
            direct.subscribe(fitting.subscription, guarded, qos)
            self._entities.append(
                (lambda own: direct.ignore(own.subscription, handler=guarded), fitting)
            )

    def expect_one_publisher(self, topic: str) -> None:
        """Make several publishers of a topic an error: their messages can't be told apart.

        Parameters
        ----------
        topic
            Topic of which one publisher is right.
        """
        self._sole.append(SolePublisher(self, topic))

    def rivals(self) -> list[str]:
        """Topics that have several publishers, with the names of their nodes."""
        return [rivals for sole in self._sole if (rivals := sole.rivals())]

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
            Topic given to `subscribe`.
        """
        return time.monotonic() - self._received_s.get(topic, self._active_since_s)

    def _open_streams(self) -> None:
        """Begin to call handlers and timers."""
        self.is_active = True
        self._active_since_s = time.monotonic()
        self._received_s.clear()
        self._look()

    def _look(self) -> None:
        for publisher in self._looking:
            publisher.look()
        for fitting in self._fitting:
            if costs := fitting.look():
                self.get_logger().warning(costs)

    def _let_arrive(self, seconds: float) -> None:
        """Wait until readers have what was published, or for a while."""
        deadline_s = time.monotonic() + seconds
        for _, entity in self._entities:
            if isinstance(entity, DirectPublisher):
                entity = entity.publisher
            if isinstance(entity, Publisher):
                left_s = max(0.0, deadline_s - time.monotonic())
                entity.wait_for_all_acked(Duration(nanoseconds=as_nanoseconds(left_s)))

    def _destroy_entities(self) -> None:
        self._looking.clear()
        self._fitting.clear()
        self._sole.clear()
        while self._entities:
            destroy, entity = self._entities.pop()
            destroy(entity)
