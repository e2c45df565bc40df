"""The end of a process that its libraries keep from ending.

While Fast DDS deletes a participant it waits for a callback about discovery that may be running.
As the ROS wheels have it built, that wait holds the lock which the callback needs: the process
takes a whole processor for ever and heeds no signal (eProsima/Fast-DDS issue 6513). It holds
Python's lock as well, so no thread of Python could end it; a timer of the system can.
"""

from __future__ import annotations

import ctypes
import time

_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of Linux: call a function with a value in a thread of its own."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('rest', ctypes.c_byte * 40),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``."""

    _fields_ = tuple(
        (name, ctypes.c_long) for name in ('period_s', 'period_ns', 'wait_s', 'wait_ns')
    )


def end_at_the_latest(seconds: int, code: int) -> None:
    """Have the system end this process after a while, whatever it does then.

    Nothing is written or tidied up at that end: call this when all that matters is done.

    Parameters
    ----------
    seconds
        Until then, at least 1.
    code
        Exit code of that end.

    Raises
    ------
    OSError
        If the system has no timer left.
    """
    system = ctypes.CDLL(None, use_errno=True)
    leave = ctypes.cast(system._exit, ctypes.c_void_p).value
    event = _Event(value=code, notify=_SIGEV_THREAD, function=leave)
    timer = ctypes.c_void_p()
    created = system.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    times = _Times(wait_s=seconds)
    if created or system.timer_settime(timer, 0, ctypes.byref(times), None):
        raise OSError(ctypes.get_errno(), 'timer_create')
