"""Serve a live page of the running loop: error, phase portrait, events and estimate.

Subscribes to the loop's topics and asks its nodes for the set-point and the tolerance. Only this
machine can open the page unless --host says otherwise. Ends on Ctrl-C.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

_FRAME_S = 0.05
_ASK_PERIOD_S = 1.0
_IDLE_FRAME_S = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `dashboard`.

    Parameters
    ----------
    parser
        Parser to extend.
    """
    parser.add_argument('--host', default='127.0.0.1', help='address to listen on')
    parser.add_argument('--port', type=int, default=8765, help='TCP port; 0: a free one')
    parser.add_argument(
        '--params-file', type=Path, help='scenario (default: ask the nodes; needed with `play`)'
    )
    parser.add_argument('--namespace', default='', help='namespace of the loop')


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C; returns the exit code.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    SuiteError
        If the port is taken or an argument breaks its rule.
    """
    from dvs_closed_loop.dashboard.dashboard_listener import DashboardListener
    from dvs_closed_loop.dashboard.dashboard_server import DashboardServer
    from dvs_closed_loop.dashboard.live_view import LiveView
    from dvs_closed_loop.running.loop_parameters import LoopParameters
    from dvs_closed_loop.running.tool import tool_node
    from dvs_common.errors import ParameterError
    from dvs_common.scenario.scenario import load_scenario

    if not 0 <= options.port <= 65535:
        raise ParameterError('port', options.port, 'must be 0 to 65535')
    scenario = load_scenario(options.params_file) if options.params_file else None
    with tool_node('dashboard', options.namespace, options.ros_arguments) as tool:
        view = LiveView(options.namespace.strip('/'))
        listener = DashboardListener(tool.node, view)
        parameters = LoopParameters(tool.node)
        server = DashboardServer(options.host, options.port)
        print(f'dashboard: {server.url}  (Ctrl-C ends it)', flush=True)
        next_question = idle_since = 0.0
        try:
            while not tool.stop.received:
                tool.spin(_FRAME_S)
                if time.monotonic() >= next_question:
                    listener.look()
                    if listener.finds_another_plant():
                        view.begin()
                        parameters.forget()
                    if scenario is None:
                        parameters.ask()
                    next_question = time.monotonic() + _ASK_PERIOD_S
                now = time.monotonic()
                if view.has_news or now - idle_since >= _IDLE_FRAME_S:
                    idle_since = now
                    server.publish(view.frame(scenario or parameters.scenario, now))
        finally:
            server.close()
    return 0
