"""Console script `dvs_closed_loop`: one command, with subcommands that are loaded when needed."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dvs_interfaces.errors import SuiteError


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand.

    Parameters
    ----------
    module
        Module with ``add_arguments(parser)`` and ``run(arguments) -> int``; imported only when the
        subcommand is called, so that one may need what another does not.
    summary
        One line for the overview.
    """

    module: str
    summary: str


COMMANDS = {
    'simulate': Command(
        'dvs_closed_loop.commands.simulate', 'run a scenario exactly, from event to event'
    ),
    'sweep': Command('dvs_closed_loop.commands.sweep', 'Monte Carlo studies over exact runs'),
    'reproduce_paper': Command(
        'dvs_closed_loop.commands.reproduce_paper', 'every figure and number of the paper'
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand.

    Parameters
    ----------
    argv
        Arguments without the program's name; default those of the process.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        prog='dvs_closed_loop',
        description='Experiments on the closed loop that need no running ROS graph.',
    )
    subparsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, command in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=command.summary, description=command.summary)
        if arguments[:1] == [name]:
            _module(command).add_arguments(subparser)
    parsed = parser.parse_args(arguments)
    try:
        return int(_module(COMMANDS[parsed.command]).run(parsed))
    except SuiteError as error:
        print(f'dvs_closed_loop {parsed.command}: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _module(command: Command) -> Any:
    return importlib.import_module(command.module)


if __name__ == '__main__':
    sys.exit(main())
