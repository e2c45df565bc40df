"""Carries frames between two network namespaces with a delay, where the kernel has no netem.

Run as a program: ``delay_line.py NAMESPACE_1 NAMESPACE_2 DEVICE DELAY_MS``. It makes a TAP device
in each namespace and passes every frame on after the delay, in order.
"""

import contextlib
import ctypes
import fcntl
import heapq
import os
import select
import struct
import sys
import time
from pathlib import Path

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
LARGEST_FRAME = 65_536


def open_tap(namespace, device):
    libc = ctypes.CDLL(None, use_errno=True)
    with Path('/var/run/netns', namespace).open() as handle:
        if libc.setns(handle.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f'cannot enter network namespace {namespace}')
    tap = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack('16sH', device.encode(), IFF_TAP | IFF_NO_PI))
    return tap


def forward(one, two, delay_s):
    partner = {one: two, two: one}
    waiting = []
    while True:
        timeout = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        readable, _, _ = select.select([one, two], [], [], timeout)
        for tap in readable:
            try:
                frame = os.read(tap, LARGEST_FRAME)
            except OSError:
                # The device is not up yet.
                time.sleep(0.01)
                continue
            heapq.heappush(waiting, (time.monotonic() + delay_s, time.monotonic_ns(), tap, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            _, _, tap, frame = heapq.heappop(waiting)
            with contextlib.suppress(OSError):
                os.write(partner[tap], frame)


def main():
    one, two, device, delay_ms = sys.argv[1:]
    taps = [open_tap(namespace, device) for namespace in (one, two)]
    print('ready', flush=True)
    forward(*taps, float(delay_ms) * 1e-3)


if __name__ == '__main__':
    main()
