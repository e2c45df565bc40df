"""Console script `dvs_closed_loop`: all tools around the loop, each imported when it is called."""

from __future__ import annotations

from collections.abc import Sequence

from dvs_common.subcommands import Command, run_subcommand
from dvs_simulation.cli import COMMANDS as SIMULATION_COMMANDS

COMMANDS = {
    **SIMULATION_COMMANDS,
    'record': Command(
        module='dvs_closed_loop.commands.record',
        summary="record the loop's topics to a bag, without rosbag2",
    ),
    'play': Command(
        module='dvs_closed_loop.commands.play',
        summary='publish a bag again with its original spacing',
    ),
    'latency': Command(
        module='dvs_closed_loop.commands.latency', summary='show where the time of a cycle goes'
    ),
    'report': Command(
        module='dvs_closed_loop.commands.report',
        summary='make figures and an HTML report of a bag',
    ),
    'dashboard': Command(
        module='dvs_closed_loop.commands.dashboard',
        summary='serve a live page of the running loop',
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `dvs_closed_loop`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    return run_subcommand('dvs_closed_loop', 'Tools around the closed loop', COMMANDS, arguments)
