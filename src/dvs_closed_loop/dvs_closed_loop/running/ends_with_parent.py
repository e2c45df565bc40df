"""Replaces itself by a program that the kernel ends when the process that started it dies.

Usage: ``python ends_with_parent.py PARENT_PID PROGRAM ARGUMENT ...``. A loop whose runner is
killed by SIGKILL would otherwise leave its nodes behind, answering in the domain of the next loop.
Run as a file, with nothing but the standard library, so that it costs some ten milliseconds.
"""

import ctypes
import os
import signal
import sys

# prctl(2): the signal that this process gets when the thread that made it dies; kept by execve.
_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Ask for SIGTERM on the parent's death, then become the program."""
    parent, program = int(sys.argv[1]), sys.argv[2]
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        sys.exit(128 + signal.SIGTERM)
    os.execv(program, sys.argv[2:])


if __name__ == '__main__':
    main()
