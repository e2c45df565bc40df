"""A small node without lifecycle, run until a signal: what the camera's tools need of rclpy."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dvs_common.node.spin import StopSignal

_TURN_S = 0.1
_USAGE_ERROR = 2


def run_plain_node(
    make_node: Callable[[], Node],
    arguments: Sequence[str],
    *,
    turn: Callable[[], bool] = lambda: True,
) -> int:
    """Run a node until SIGINT, SIGTERM or `turn` says so, and take it down.

    Parameters
    ----------
    make_node
        Makes the node.
    arguments
        Command line with ROS arguments.
    turn
        Called between messages and at least every 0.1 s; returns whether to go on.

    Returns
    -------
    int
        Exit code: 0, or 2 if ROS can't start.
    """
    stop = StopSignal()
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        print(f'cannot start: {" ".join(str(error).split())}', file=sys.stderr)
        return _USAGE_ERROR
    node = make_node()
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        while not stop.received and rclpy.ok() and turn():
            # Without a timeout this deadlocks; see dvs_common.node.spin.
            executor.spin_once(timeout_sec=_TURN_S)
    finally:
        executor.remove_node(node)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
