"""Two hosts on one machine: network namespaces joined by a cable with a delay."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from loop_support import wait_for

DEVICE = 'cable0'


@dataclass(frozen=True)
class Host:
    name: str
    address: str

    def command(self, *words: str) -> list[str]:
        return ['ip', 'netns', 'exec', self.name, *words]


def run(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run(words, capture_output=True, text=True)


def require(*words: str) -> None:
    done = run(*words)
    if done.returncode:
        pytest.skip(f'this machine cannot do "{" ".join(words)}": {done.stderr.strip()}')


@contextmanager
def two_hosts(delay_ms: float) -> Iterator[tuple[Host, Host]]:
    """Joined hosts with a delay in each direction; skips the test where they can't be made."""
    if os.geteuid() != 0:
        pytest.skip('network namespaces need root')
    if shutil.which('ip') is None:
        pytest.skip('network namespaces need the command ip (apt install iproute2)')
    hosts = tuple(
        Host(f'dvs{os.getpid()}{side}', f'10.77.0.{i}') for i, side in ((1, 'a'), (2, 'b'))
    )
    line = None
    try:
        for host in hosts:
            require('ip', 'netns', 'add', host.name)
        if not join_by_veth(hosts, delay_ms):
            line = join_by_delay_line(hosts, delay_ms)
        for host in hosts:
            require('ip', '-n', host.name, 'addr', 'add', f'{host.address}/24', 'dev', DEVICE)
            for device in ('lo', DEVICE):
                require('ip', '-n', host.name, 'link', 'set', device, 'up')
        # Fast DDS takes the devices that run when a node starts and looks no second time; after
        # `up` the kernel may take a second to call a device running.
        assert wait_for(lambda: all(is_running(host) for host in hosts)), 'the cable stays down'
        yield hosts
    finally:
        if line is not None:
            line.kill()
            line.communicate()
        for host in hosts:
            run('ip', 'netns', 'del', host.name)


def is_running(host: Host) -> bool:
    shown = run('ip', '-n', host.name, 'link', 'show', 'dev', DEVICE)
    return shown.returncode == 0 and 'state DOWN' not in shown.stdout


def join_by_veth(hosts: tuple[Host, Host], delay_ms: float) -> bool:
    """Join by a veth pair; False where the wanted delay needs a netem that is missing."""
    one, two = (host.name for host in hosts)
    peer = ('peer', 'name', DEVICE, 'netns', two)
    require('ip', 'link', 'add', DEVICE, 'netns', one, 'type', 'veth', *peer)
    if not delay_ms:
        return True
    netem = ('root', 'netem', 'delay', f'{delay_ms:g}ms')
    if all(
        run('tc', '-n', h.name, 'qdisc', 'add', 'dev', DEVICE, *netem).returncode == 0
        for h in hosts
    ):
        return True
    run('ip', '-n', one, 'link', 'del', DEVICE)
    return False


def join_by_delay_line(hosts: tuple[Host, Host], delay_ms: float) -> subprocess.Popen:
    program = Path(__file__).with_name('delay_line.py')
    line = subprocess.Popen(
        [sys.executable, str(program), *(host.name for host in hosts), DEVICE, str(delay_ms)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if line.stdout.readline().strip() != 'ready':
        _, reason = line.communicate()
        pytest.skip(f'neither netem nor a TAP device: {reason.strip().splitlines()[-1]}')
    return line
