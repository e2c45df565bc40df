"""How a program of the suite begins and ends: a signal ends it in order from the first import on.

Entry points name this module and nothing that imports more, so that the handlers are there before
NumPy and rclpy, which take half a second.
"""

from __future__ import annotations

import errno
import gc
import os
import re
import select
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import FrameType

from dvs_common.late_imports import import_less

# Ctrl-C, the end of a service, a closed terminal or ssh session.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_LEAST_SHARED_MEMORY_BYTES = 1 << 16

Handler = Callable[[int, FrameType | None], None]


class StopSignal:
    """Remembers a signal that ends the program, which then ends in order at its next turn.

    Attributes
    ----------
    received
        Whether one has come.
    is_of_program
        Whether it was made by a program of the suite, not by a notebook or a test.
    """

    def __init__(self) -> None:
        self.received = False
        self._before = {number: signal.getsignal(number) for number in ENDING}
        self.is_of_program = self._before[signal.SIGTERM] in (_interrupt, _leave)
        _handle(self._receive)

    def __enter__(self) -> StopSignal:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Put back the handlers of before: Ctrl-C interrupts a notebook or a test again.

        Not in a program of the suite: a second signal must not interrupt what it does at its end.
        """
        for number, before in self._before.items():
            if signal.getsignal(number) == self._receive and before not in (None, _interrupt):
                signal.signal(number, before)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True


def run_program(module: str) -> int:
    """Import a module and run its `main`; returns the exit code, 0 after a signal.

    A signal ends the program at once while it imports. Later it interrupts `main` like Ctrl-C,
    unless `main` makes a `StopSignal`. Output into a pipe that is no longer read, as with
    ``| head``, ends it as well.

    Parameters
    ----------
    module
        Full name of the module.
    """
    code = 1
    try:
        code = _exit_code(module)
        return code
    finally:
        # While the interpreter goes, a second signal would end it with another exit code.
        _handle(signal.SIG_IGN)
        if sys.modules.get('rclpy') is not None:
            # Not before what is imported first, the handlers of signals.
            from dvs_common.latest_end import end_soon

            end_soon(code)


def _exit_code(module: str) -> int:
    _handle(_leave)
    _let_warnings_be_warnings()
    _let_numba_have_a_thread()
    if _shared_memory_is_full():
        # The tracing library that rclpy loads would be killed by SIGBUS.
        sys.modules['rclpy'] = None  # type: ignore[assignment]
    import_less()
    try:
        with _no_search_for_garbage():
            main = import_module(module).main
        _handle(_interrupt)
        code = int(main())
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:
        if not _output_is_closed():
            raise
        _drop_output()
        return 0
    except OSError as error:
        if error.errno != errno.ENOSPC or error.filename:
            raise
        _drop_output()
        print(f'{_program()}: standard output: {error.strerror}', file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        missing = (error.name or 'dvs_').partition('.')[0]
        if missing.startswith('dvs_'):
            raise
        if missing == 'rclpy' and _shared_memory_is_full():
            print(f'{_program()}: /dev/shm is full, and ROS needs some of it', file=sys.stderr)
            return 1
        print(
            f'{_program()}: needs the package {missing}, which is not installed'
            f'{_extra_with(missing, module)}',
            file=sys.stderr,
        )
        return 1


def _extra_with(missing: str, module: str) -> str:
    """Which extra of our packages has a package, that of the program's own first."""
    from importlib.metadata import distributions

    own = module.partition('.')[0]
    needs: dict[str, list[str]] = {}
    for one in distributions():
        if (name := (one.name or '').replace('-', '_')).startswith('dvs_'):
            needs.setdefault(name, one.requires or [])
    for name in sorted(needs, key=lambda name: (name != own, name)):
        for requirement in needs[name]:
            extra = re.match(rf'(?:[\w-]*-)?{missing}\b.*extra == [\'"](\w+)', requirement)
            if extra and extra[1] != 'test':
                return f'; it comes with {name}[{extra[1]}]'
    return ''


@contextmanager
def importing() -> Iterator[None]:
    """Let a signal end the program at once while it imports more: nothing is to be tidied up."""
    is_program = signal.getsignal(signal.SIGTERM) is _interrupt
    if is_program:
        _handle(_leave)
    with _no_search_for_garbage():
        yield
    if is_program:
        _handle(_interrupt)


@contextmanager
def _no_search_for_garbage() -> Iterator[None]:
    """Imports make many objects and no garbage: the searches would take a tenth of their time.

    What is imported stays: no later search needs to look at it, nor that at the end.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def ignore_signals() -> None:
    """Let nothing interrupt what a program still does at its end."""
    _handle(signal.SIG_IGN)


def _handle(handler: Handler | signal.Handlers) -> None:
    for number in ENDING:
        # nohup has a program ignore that its terminal is closed.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _let_warnings_be_warnings() -> None:
    """Keep ``PYTHONWARNINGS=error`` from ending a program by what a library warns of."""
    if any(option.startswith('error') for option in sys.warnoptions):
        os.environ['PYTHONWARNINGS'] = 'default'
        warnings.simplefilter('default')


def _let_numba_have_a_thread() -> None:
    """Leave out a NUMBA_NUM_THREADS below 1, with which numba cannot be imported."""
    wanted = os.environ.get('NUMBA_NUM_THREADS', '')
    if re.fullmatch(r'\s*([+-]?0+|-\d+)\s*', wanted):
        del os.environ['NUMBA_NUM_THREADS']
        print(
            f'{_program()}: NUMBA_NUM_THREADS={wanted} is left out: it must be at least 1',
            file=sys.stderr,
        )


def _shared_memory_is_full() -> bool:
    try:
        disk = os.statvfs('/dev/shm')
    except OSError:
        return False
    return disk.f_blocks > 0 and disk.f_bavail * disk.f_frsize < _LEAST_SHARED_MEMORY_BYTES


def _program() -> str:
    return sys.argv[0].rpartition('/')[2]


def _drop_output() -> None:
    """Let what is still in the buffer go, so that it does not fail once more at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _output_is_closed() -> bool:
    pipe = select.poll()
    pipe.register(sys.stdout.fileno(), 0)
    return bool(pipe.poll(0))


def _leave(number: int, frame: FrameType | None) -> None:
    os._exit(0)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
