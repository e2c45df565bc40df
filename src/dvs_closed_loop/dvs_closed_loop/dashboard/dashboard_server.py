"""Serves the live page: a template, three files and one stream of frames (server-sent events).

A page from another site must not read the loop through the visitor's browser (DNS rebinding,
foreign origins), so only requests to the names under which the page is meant to be reached are
answered.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from importlib.resources import files
from ipaddress import ip_address
from typing import Any

from aiohttp import web

from dvs_common.errors import ParameterError
from dvs_simulation.html_page import page

_FILES = {
    '/dashboard.css': ('dashboard.css', 'text/css'),
    '/dashboard.js': ('dashboard.js', 'text/javascript'),
    '/icon.svg': ('icon.svg', 'image/svg+xml'),
}
_HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
}
# Times that the panels show, s, and the one that a page begins with.
_WINDOWS, _WINDOW = (1, 2, 5, 10, 30), 5
# Frames that a page gets at once when it opens, and that may wait for a slow one.
_HISTORY = 400
_WAITING = 100
_START_TIMEOUT_S = 10.0
_CLOSE_TIMEOUT_S = 1.0


class DashboardServer:
    """Web server in a thread of its own.

    Parameters
    ----------
    host
        Address or name to listen on.
    port
        TCP port; 0 for a free one.

    Raises
    ------
    ParameterError
        If it can't listen there.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._history: deque[str] = deque(maxlen=_HISTORY)
        self._pages: set[asyncio.Queue[str]] = set()
        self._loop = asyncio.new_event_loop()
        self._runner: web.AppRunner | None = None
        self._thread = threading.Thread(target=self._run, name='dashboard', daemon=True)
        self._thread.start()
        starting = asyncio.run_coroutine_threadsafe(self._start(port), self._loop)
        try:
            self.port = starting.result(_START_TIMEOUT_S)
        except OSError as error:
            self._end_thread()
            raise ParameterError(
                'port', port, f"can't listen on {host}: {error.strerror or error}"
            ) from None

    @property
    def url(self) -> str:
        """Address of the page."""
        host = 'localhost' if self._host in ('', '0.0.0.0', '::') else self._host
        return f'http://{f"[{host}]" if ":" in host else host}:{self.port}/'

    def publish(self, frame: dict[str, Any]) -> None:
        """Send a frame to every open page.

        Parameters
        ----------
        frame
            Anything that JSON can hold.
        """
        text = json.dumps(frame, separators=(',', ':'), allow_nan=False)
        self._loop.call_soon_threadsafe(self._spread, text, frame)

    def close(self) -> None:
        """Close all connections and end the thread."""
        if self._runner is not None:
            closing = asyncio.run_coroutine_threadsafe(self._runner.cleanup(), self._loop)
            closing.result(_START_TIMEOUT_S)
        self._end_thread()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    def _end_thread(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_START_TIMEOUT_S)
        self._loop.close()

    async def _start(self, port: int) -> int:
        application = web.Application(middlewares=[_guard(self._host)])
        page_text = page(
            'dvs_closed_loop.dashboard', 'page.html.j2', windows=_WINDOWS, window=_WINDOW
        )
        application.router.add_get('/', _handler_of(page_text.encode(), 'text/html'))
        for path, (name, content_type) in _FILES.items():
            application.router.add_get(path, _handler_of(_web_file(name), content_type))
        application.router.add_get('/stream', self._stream)
        runner = web.AppRunner(
            application, access_log=None, handle_signals=False, shutdown_timeout=_CLOSE_TIMEOUT_S
        )
        await runner.setup()
        try:
            site = web.TCPSite(runner, self._host or None, port)
            await site.start()
        except OSError:
            await runner.cleanup()
            raise
        self._runner = runner
        return int(runner.addresses[0][1])

    def _spread(self, text: str, frame: dict[str, Any]) -> None:
        if frame.get('restart'):
            self._history.clear()
        if frame.get('state') or frame.get('events'):
            self._history.append(text)
        for waiting in self._pages:
            if waiting.full():
                waiting.get_nowait()
            waiting.put_nowait(text)

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse(
            headers={**_HEADERS, 'Content-Type': 'text/event-stream', 'X-Accel-Buffering': 'no'}
        )
        await response.prepare(request)
        waiting: asyncio.Queue[str] = asyncio.Queue(_WAITING)
        past = f'[{",".join(self._history)}]'
        self._pages.add(waiting)
        try:
            await response.write(f'event: past\ndata: {past}\n\n'.encode())
            while True:
                text = await waiting.get()
                await response.write(f'data: {text}\n\n'.encode())
        except (ConnectionError, asyncio.CancelledError):
            return response
        finally:
            self._pages.discard(waiting)


def is_expected_host(host: str, listening: str) -> bool:
    """Whether a request's Host header names this page, and not a site that points to it.

    A name can be made to point here by the owner of the name; an address and ``localhost`` can't.

    Parameters
    ----------
    host
        Host header, with or without a port.
    listening
        Address or name that the server listens on.
    """
    name = host.rpartition(']')[0].lstrip('[') if host.startswith('[') else host.partition(':')[0]
    name = name.lower()
    if name in ('localhost', listening.lower()):
        return True
    try:
        address = ip_address(name)
    except ValueError:
        return False
    return address.is_loopback or not _is_loopback(listening)


def _is_loopback(listening: str) -> bool:
    try:
        return ip_address(listening).is_loopback
    except ValueError:
        return listening.lower() == 'localhost'


Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def _guard(listening: str) -> Any:
    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not is_expected_host(request.headers.get('Host', ''), listening):
            return web.Response(status=421, text='this host is not served here\n')
        origin = request.headers.get('Origin')
        if origin is not None and not is_expected_host(origin.partition('://')[2], listening):
            return web.Response(status=403, text='this origin is not served here\n')
        return await handler(request)

    return guard


def _web_file(name: str) -> bytes:
    return files('dvs_closed_loop').joinpath('dashboard', 'web', name).read_bytes()


def _handler_of(body: bytes, content_type: str) -> Handler:
    async def handle(request: web.Request) -> web.Response:
        return web.Response(
            body=body, headers=_HEADERS, content_type=content_type, charset='utf-8'
        )

    return handle
