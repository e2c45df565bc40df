"""Console script `dvs_simulation`: the tools that need no ROS."""

from __future__ import annotations

from collections.abc import Sequence

from dvs_common.subcommands import Command, run_subcommand

COMMANDS = {
    'simulate': Command(
        'dvs_simulation.commands.simulate', 'run a scenario exactly, from event to event'
    ),
    'sweep': Command('dvs_simulation.commands.sweep', 'Monte Carlo studies over exact runs'),
    'reproduce_paper': Command(
        'dvs_simulation.commands.reproduce_paper', 'every figure and number of the paper'
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
