"""Console script `dvs_simulation`: the tools that need no ROS."""

from __future__ import annotations

from collections.abc import Sequence

from dvs_common.subcommands import Command, run_subcommand

COMMANDS = {
    'simulate': Command(
        module='dvs_simulation.commands.simulate',
        summary='run a scenario exactly, from event to event',
    ),
    'sweep': Command(
        module='dvs_simulation.commands.sweep', summary='Monte Carlo studies over exact runs'
    ),
    'reproduce_paper': Command(
        module='dvs_simulation.commands.reproduce_paper',
        summary='every figure and number of the paper',
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `dvs_simulation`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    return run_subcommand('dvs_simulation', 'Simulation without ROS', COMMANDS, arguments)
