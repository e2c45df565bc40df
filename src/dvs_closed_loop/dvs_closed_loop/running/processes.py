"""Node processes: started like `ros2 run` does, ended in order, never left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from dvs_common.errors import ParameterError
from dvs_common.node.node_plan import NodePlan

_GRACE_S = 5.0
# Isolated and without site packages: quick, and independent of the user's Python settings.
_TIED_TO_US = (sys.executable, '-I', '-S', Path(__file__).with_name('ends_with_parent.py'))


def executable_path(package: str, executable: str) -> Path:
    """Path of an installed executable, where `ros2 run` looks for it.

    Parameters
    ----------
    package
        Name of the package.
    executable
        Name of the executable.

    Raises
    ------
    ParameterError
        If the package is not in AMENT_PREFIX_PATH or has no such executable.
    """
    try:
        prefix = get_package_prefix(package)
    except PackageNotFoundError:
        raise ParameterError(
            'package', package, 'is not in AMENT_PREFIX_PATH; is the workspace built and sourced?'
        ) from None
    path = Path(prefix) / 'lib' / package / executable
    if not path.is_file():
        raise ParameterError('executable', executable, f'is not installed at {path}')
    return path


def program_path(plan: NodePlan) -> Path:
    """Path of a planned node's program.

    Parameters
    ----------
    plan
        What to start.

    Raises
    ------
    ParameterError
        If it is not installed.
    """
    if not plan.package:
        return Path(plan.executable)
    return executable_path(plan.package, plan.executable)


def ending(exit_code: int) -> str:
    """How a process ended, in words.

    Parameters
    ----------
    exit_code
        Its exit code; of one that a signal has killed, less than 0.
    """
    if exit_code < 0:
        return f'was killed by signal {-exit_code}'
    return f'ended with exit code {exit_code}'


class NodeProcess:
    """One running node.

    Parameters
    ----------
    plan
        What to start.
    """

    def __init__(self, plan: NodePlan) -> None:
        self.name = plan.name
        environment = {**os.environ}
        environment.setdefault('RCUTILS_CONSOLE_OUTPUT_FORMAT', '[{name}] {severity}: {message}')
        with _interrupts_ignored():
            self._process = subprocess.Popen(
                [*_TIED_TO_US, str(os.getpid()), program_path(plan), *plan.arguments],
                env=environment,
                stdin=subprocess.DEVNULL,
            )

    @property
    def exit_code(self) -> int | None:
        """Exit code, or None while it runs."""
        return self._process.poll()

    def stop(self) -> int:
        """End the node with SIGTERM, or SIGKILL if it does not react; return its exit code."""
        if self._process.poll() is None:
            self._process.terminate()
        try:
            return self._process.wait(timeout=_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Let a child inherit that SIGINT is ignored, until it has a handler of its own.

    A Ctrl-C in the terminal reaches the whole process group; a node that is still importing would
    answer with a traceback.
    """
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
