"""Topic names and quality of service of the wire contract.

The names serve those who have no ROS as well, so that rclpy is imported with the first QoS.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

LUMINOSITY = 'luminosity'
EVENTS = 'events'
EVENTS_LABEL = 'events_label'
EVENTS_PACKET = 'events_packet'
POLARITY = 'polarity'
EVENT_IMAGE = 'event_image'
EVENT_CLOUD = 'event_cloud'
KEYFRAME = 'keyframe'
KEYFRAME_REQUEST = 'keyframe_request'
ANCHOR = 'anchor'
COMMAND = 'command'
# Commands as others take them; ros2_controllers, mobile bases and thrusters call them so.
COMMAND_ARRAY = 'commands'
COMMAND_TWIST = 'cmd_vel'
COMMAND_WRENCH = 'wrench'
STATE = 'state'
ESTIMATE = 'estimate'
CLOCK = '/clock'
DIAGNOSTICS = '/diagnostics'

_DEPTH = 100
# Messages that wait in the middleware for a listener that is away, if they are small ones.
LISTENER_DEPTH = 4000
_HISTORY_BYTES = 64_000_000
_BACKLOG_BYTES = 256_000_000
_LEAST_BACKLOG = 8


def history_depth(message_bytes: int) -> int:
    """Depth of a loop's stream: its listeners may be away for seconds, for at most 64 MB.

    A reliable stream loses what falls out of its history before a listener has it, and on a busy
    machine a listener may not run for some tenths of a second: hundreds of samples in lockstep.

    Parameters
    ----------
    message_bytes
        Size of a large message of the stream.

    Returns
    -------
    int
        Number of messages, 100 to 4000.
    """
    return max(_DEPTH, min(LISTENER_DEPTH, _HISTORY_BYTES // message_bytes))


def backlog_depth(message_bytes: int) -> int:
    """Depth of a subscription that may not keep up: what waits takes at most 256 MB.

    Parameters
    ----------
    message_bytes
        Size of a message.

    Returns
    -------
    int
        Number of messages, 8 to 100.
    """
    return max(_LEAST_BACKLOG, min(_DEPTH, _BACKLOG_BYTES // message_bytes))


def stream_qos(depth: int = _DEPTH) -> QoSProfile:
    """QoS of a stream that must not lose a message: reliable, volatile, deep.

    Parameters
    ----------
    depth
        Number of messages that wait for a listener that is away.
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched_qos(depth: int = _DEPTH) -> QoSProfile:
    """QoS of a stream whose last messages wait for late subscribers: reliable, transient local.

    Parameters
    ----------
    depth
        Number of messages that wait.
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def handshake_qos(mode: str, depth: int = _DEPTH) -> QoSProfile:
    """QoS of ``events`` and ``command``, the two messages that a lockstep partner waits for.

    In lockstep they are latched: the one token in flight is not lost if its reader comes late, so
    that start order does not matter. In realtime they are volatile, which every driver offers.

    Parameters
    ----------
    mode
        ``lockstep`` or ``realtime``.
    depth
        Number of messages that wait.
    """
    return latched_qos(depth) if mode == 'lockstep' else stream_qos(depth)


def clock_qos() -> QoSProfile:
    """QoS of /clock, as rclpy's own time source asks for it."""
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def fitting_qos(asked: QoSProfile, offered: Sequence[QoSProfile]) -> QoSProfile:
    """QoS of a subscription that all publishers of its topic match.

    Parameters
    ----------
    asked
        What the subscription would rather have.
    offered
        QoS of every publisher.

    Returns
    -------
    QoSProfile
        Best effort or volatile where one of the publishers is.
    """
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    fitting = copy(asked)
    if any(qos.reliability == ReliabilityPolicy.BEST_EFFORT for qos in offered):
        fitting.reliability = ReliabilityPolicy.BEST_EFFORT
    if any(qos.durability == DurabilityPolicy.VOLATILE for qos in offered):
        fitting.durability = DurabilityPolicy.VOLATILE
    return fitting
