"""Topic names and quality of service of the wire contract.

The names serve those who have no ROS as well, so that rclpy is imported with the first QoS.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

LUMINOSITY = 'luminosity'
EVENTS = 'events'
EVENTS_LABEL = 'events_label'
EVENTS_PACKET = 'events_packet'
POLARITY = 'polarity'
EVENT_IMAGE = 'event_image'
KEYFRAME = 'keyframe'
KEYFRAME_REQUEST = 'keyframe_request'
THRESHOLD = 'threshold'
COMMAND = 'command'
STATE = 'state'
ESTIMATE = 'estimate'
CLOCK = '/clock'
DIAGNOSTICS = '/diagnostics'

_DEPTH = 100


def stream_qos() -> QoSProfile:
    """QoS of a stream that must not lose a message: reliable, volatile, deep."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=_DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched_qos(depth: int = _DEPTH) -> QoSProfile:
    """QoS of a stream whose last messages wait for whoever comes late: reliable, transient local.

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


def handshake_qos(mode: str) -> QoSProfile:
    """QoS of ``events`` and ``command``, the two messages that a lockstep partner waits for.

    In lockstep they are latched: the one token in flight is not lost if its reader comes late, so
    that start order does not matter. In realtime they are volatile, which every driver offers.

    Parameters
    ----------
    mode
        ``lockstep`` or ``realtime``.
    """
    return latched_qos() if mode == 'lockstep' else stream_qos()


def clock_qos() -> QoSProfile:
    """QoS of /clock, as rclpy's own time source asks for it."""
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
