"""The end of a process that its libraries keep from ending.

While Fast DDS deletes a participant it waits for a callback about discovery that may be running.
As the ROS wheels have it built, that wait holds the lock which the callback needs: the process
takes a whole processor for ever and heeds no signal (eProsima/Fast-DDS issue 6513). It holds
Python's lock as well, so no thread of Python could end it; a timer of the system can.
"""

from __future__ import annotations

import atexit
import ctypes
import time

# Libraries take a tenth of that to end; closed_loop and ros2 launch give up after 5 s.
_LONGEST_END_S = 3
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


def end_soon(code: int) -> None:
    """Let no library keep this process from ending once its interpreter ends.

    Where the system has no timer for that, the end is the usual one.

    Parameters
    ----------
    code
        Exit code of a process that a library keeps.
    """
    # Once, though a program of the suite and the nodes in it both ask.
    atexit.unregister(_set_timer)
    atexit.register(_set_timer, code)


def _set_timer(code: int) -> None:
    system = ctypes.CDLL(None)
    if not hasattr(system, 'timer_create'):
        return
    leave = ctypes.cast(system._exit, ctypes.c_void_p).value
    event = _Event(value=code, notify=_SIGEV_THREAD, function=leave)
    timer = ctypes.c_void_p()
    if system.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        return
    system.timer_settime(timer, 0, ctypes.byref(_Times(wait_s=_LONGEST_END_S)), None)
