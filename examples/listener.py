#!/usr/bin/env python3
"""A subscriber of `events` that counts what it missed: depth, absolute times, gaps in the index.

Print after a while how many packets and events came, and how many events did not. `--away` lets it
not run for so long once a second, as a plot that is redrawn does.
"""

import argparse
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from dvs_common import IndexWatch, event_times_ns, parse_events
from dvs_common.nanoseconds import as_seconds


class Listener:
    """Counts packets, events and gaps.

    Parameters
    ----------
    node
        Node that carries the subscription.
    depth
        Messages that wait for it while it does not run.
    """

    def __init__(self, node: Node, depth: int) -> None:
        self.packets = 0
        self.span_ns: list[int] = []
        self.watch = IndexWatch()
        qos = QoSProfile(depth=depth)
        node.create_subscription(PointCloud2, 'events', self.take, qos, raw=True)

    def take(self, message: bytes) -> None:
        """Count one packet."""
        packet = parse_events(message)
        self.packets += 1
        self.watch.take(packet)
        times_ns = event_times_ns(packet)
        if times_ns.size:
            self.span_ns = [*self.span_ns[:1], int(times_ns[0]), int(times_ns[-1])]


def main() -> None:
    """Listen for a while and print what came."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--depth', type=int, default=1000, help='of the subscription (1000)')
    parser.add_argument('--away', type=float, default=0.0, help='s a second not to run (0)')
    parser.add_argument('--seconds', type=float, default=10.0, help='how long to listen (10)')
    options = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('listener')
    listener = Listener(node, options.depth)
    end = time.monotonic() + options.seconds
    back_until = time.monotonic() + 1.0
    while (now := time.monotonic()) < end:
        rclpy.spin_once(node, timeout_sec=0.05)
        if options.away and now > back_until:
            time.sleep(options.away)
            back_until = time.monotonic() + 1.0
    span_s = as_seconds(listener.span_ns[-1] - listener.span_ns[0]) if listener.span_ns else 0.0
    print(
        f'depth {options.depth}, away {options.away:g} s: {listener.packets} packets, '
        f'{listener.watch.events} events in {span_s:.3f} s, {listener.watch.lost} missed in '
        f'{listener.watch.gaps} gaps'
    )


if __name__ == '__main__':
    main()
