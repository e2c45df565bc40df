"""Where the middleware must not use shared memory, and how that is switched off.

Fast DDS is killed (SIGBUS) by a full /dev/shm. What it puts there can be written by its owner
alone: nodes of two users find each other, and no message arrives.
"""

from __future__ import annotations

import fcntl
import os
import pwd
import re
import sys
from pathlib import Path

from dvs_common.node.middleware_periods import PROFILES, is_fast_dds_ours

# What the middleware of a loop takes of it, with something to spare.
_ROOM_BYTES = 8 << 20
# Ports of a domain begin there and take so many (RTPS 2.2, 9.6.1.1).
_FIRST_PORT, _PORTS = 7400, 250

_TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'
_UDP_ON_THIS_MACHINE = Path(__file__).with_name('udp_on_this_machine.xml')


def leave_shared_memory_where_needed(domain: int, folder: str = '/dev/shm') -> None:
    """Let the middleware use UDP alone where shared memory is full or another user's.

    Parameters
    ----------
    domain
        The ROS domain.
    folder
        Where shared memory is.
    """
    if _TRANSPORTS in os.environ or not is_fast_dds_ours():
        return
    reason = _lack_of_room(folder) or _another_user(domain, folder)
    if reason is not None:
        _use_udp_alone()
        print(f'{reason}: messages go by UDP alone', file=sys.stderr)


def _lack_of_room(folder: str) -> str | None:
    try:
        disk = os.statvfs(folder)
    except OSError:
        return None
    free = disk.f_bavail * disk.f_frsize
    return f'{folder} has {free >> 10} kB left' if disk.f_blocks and free < _ROOM_BYTES else None


def _another_user(domain: int, folder: str) -> str | None:
    """Find who else has nodes in the domain: each holds the lock of its port."""
    first = _FIRST_PORT + _PORTS * domain
    try:
        locks = list(Path(folder).iterdir())
    except OSError:
        return None
    for lock in locks:
        port = re.fullmatch(r'fastrtps_port(\d+)_el', lock.name)
        if port and first <= int(port[1]) < first + _PORTS:
            owner = _owner(lock)
            if owner is not None and owner != os.geteuid() and _is_held(lock):
                return f'user {_user_name(owner)} has nodes in domain {domain} too'
    return None


def _owner(lock: Path) -> int | None:
    try:
        return lock.stat().st_uid
    except OSError:
        return None


def _is_held(lock: Path) -> bool:
    """Whether a process holds a lock, or may: it can't be tried."""
    try:
        with lock.open('rb') as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return True
    except OSError:
        return False
    return False


def _user_name(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _use_udp_alone() -> None:
    is_local = os.environ.get(_RANGE, '').upper() == 'LOCALHOST'
    if is_local or os.environ.get(_LOCALHOST_ONLY) == '1':
        # That range adds shared memory whatever the transports are set to.
        os.environ.pop(_LOCALHOST_ONLY, None)
        os.environ.update({_RANGE: 'SYSTEM_DEFAULT', PROFILES: str(_UDP_ON_THIS_MACHINE)})
    else:
        os.environ[_TRANSPORTS] = 'UDPv4'
