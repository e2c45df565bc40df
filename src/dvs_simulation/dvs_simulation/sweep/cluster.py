"""Where a sweep runs: processes of this machine, or a Dask scheduler somewhere.

A program that reaches a Dask scheduler can run any code on its workers. So the local cluster
listens on loopback alone, its web page is off unless asked for, and a shared scheduler takes TLS
files.
"""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from dvs_common.errors import ParameterError

_LOOPBACK = '127.0.0.1'
_ANY_PORT = 0
# A scheduler that is there answers within this time.
_ANSWER_S = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class TlsFiles:
    """Files that prove to a shared scheduler who we are, and to us who it is (PEM).

    Parameters
    ----------
    authority
        Certificate of the authority that signed both.
    certificate
        Our certificate.
    key
        Its key.
    """

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Cluster:
    """Workers of a sweep.

    Parameters
    ----------
    scheduler
        Address of a Dask scheduler, as ``tcp://host:8786`` or ``tls://host:8786``; None for a
        cluster on this machine.
    workers
        Workers of the local cluster; None for one a core.
    processes
        Whether local workers are processes; threads serve small sweeps and tests.
    dashboard_port
        Port on loopback of Dask's web page; None for no page.
    tls
        TLS files for a ``tls://`` scheduler.
    """

    scheduler: str | None = None
    workers: int | None = None
    processes: bool = True
    dashboard_port: int | None = None
    tls: TlsFiles | None = None

    @contextmanager
    def client(self) -> Iterator[Any]:
        """Dask client of these workers, closed at the end.

        Raises
        ------
        ParameterError
            If the scheduler does not answer, or TLS files and address do not belong together.
        """
        distributed: Any = import_module('distributed')
        if self.scheduler is not None:
            with self._remote(distributed, self.scheduler) as client:
                yield client
            return
        with ExitStack() as opened:
            with interrupts_for_us_alone():
                local = opened.enter_context(
                    distributed.LocalCluster(
                        host=_LOOPBACK if self.processes else None,
                        n_workers=self.workers or os.cpu_count(),
                        threads_per_worker=1,
                        processes=self.processes,
                        dashboard_address=f'{_LOOPBACK}:{self.dashboard_port or _ANY_PORT}',
                        scheduler_kwargs={'dashboard': self.dashboard_port is not None},
                        worker_dashboard_address=None,
                        silence_logs=50,
                    )
                )
            yield opened.enter_context(distributed.Client(local))

    def _remote(self, distributed: Any, scheduler: str) -> Any:
        if scheduler.startswith('tls://') != (self.tls is not None):
            raise ParameterError(
                'scheduler', scheduler, 'must begin with tls:// just where TLS files are given'
            )
        security = None
        if self.tls is not None:
            for file in (self.tls.authority, self.tls.certificate, self.tls.key):
                if not file.is_file():
                    raise ParameterError('tls', file, 'is not a file')
            security = distributed.Security(
                tls_ca_file=str(self.tls.authority),
                tls_client_cert=str(self.tls.certificate),
                tls_client_key=str(self.tls.key),
                require_encryption=True,
            )
        _require_answer(scheduler)
        try:
            return distributed.Client(scheduler, timeout=_ANSWER_S, security=security)
        except (OSError, ValueError) as error:
            raise ParameterError('scheduler', scheduler, f'does not answer: {error}') from None


@contextmanager
def interrupts_for_us_alone() -> Iterator[None]:
    """Let children and threads inherit that SIGINT is blocked; one that comes meanwhile waits.

    Ctrl-C reaches the whole process group, and every worker would answer with a traceback, as
    would a cluster that is closed before all of it has started.
    """
    # Its first start would let SIGINT through again.
    resource_tracker.ensure_running()
    with _late_interrupts():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _late_interrupts() -> Iterator[None]:
    """Handle a SIGINT at the end: older threads, as those of BLAS, do not block it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def _require_answer(scheduler: str) -> None:
    """Refuse an address without a listening scheduler.

    A client of Dask that fails to connect is left behind, and may block the next cluster of the
    process when it is collected.
    """
    try:
        url = urlsplit(scheduler)
        if url.scheme not in ('tcp', 'tls') or not url.hostname or not url.port:
            raise ValueError('it must be tcp://HOST:PORT or tls://HOST:PORT')
        socket.create_connection((url.hostname, url.port), timeout=_ANSWER_S).close()
    except (OSError, ValueError) as error:
        raise ParameterError('scheduler', scheduler, f'does not answer: {error}') from None


THIS_MACHINE = Cluster()
