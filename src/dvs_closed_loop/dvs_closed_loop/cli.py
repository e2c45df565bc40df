"""Console script `dvs_closed_loop`: one door to all tools, each loaded when it is asked for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

from dvs_interfaces.errors import SuiteError


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand.

    Parameters
    ----------
    module
        Module with ``add_arguments(parser)`` and ``run(options) -> int``; imported only when the
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
    'record': Command(
        'dvs_closed_loop.record', "record the loop's topics to a bag, without rosbag2"
    ),
    'play': Command('dvs_closed_loop.play', 'publish a bag again with its original spacing'),
    'latency': Command('dvs_closed_loop.latency', 'show where the time of a cycle goes'),
    'report': Command('dvs_closed_loop.report', 'make figures and an HTML report of a bag'),
    'dashboard': Command('dvs_closed_loop.dashboard', 'serve a live page of the running loop'),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `dvs_closed_loop`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    name = _parser().parse_args(own[:1]).command
    module = import_module(COMMANDS[name].module)
    parser = argparse.ArgumentParser(
        prog=f'dvs_closed_loop {name}', description=COMMANDS[name].summary
    )
    module.add_arguments(parser)
    options = parser.parse_args(own[1:])
    options.ros_arguments = ros_arguments
    try:
        return int(module.run(options))
    except SuiteError as error:
        print(f'dvs_closed_loop {name}: {error}', file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f'dvs_closed_loop {name}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our arguments, and those from ``--ros-args`` to ``--`` or the end.

    Parameters
    ----------
    arguments
        Command line.
    """
    if '--ros-args' not in arguments:
        return list(arguments), []
    start = list(arguments).index('--ros-args')
    tail = list(arguments[start:])
    end = tail.index('--') + 1 if '--' in tail else len(tail)
    return [*arguments[:start], *tail[end:]], tail[:end]


def _parser() -> argparse.ArgumentParser:
    width = max(map(len, COMMANDS))
    lines = '\n'.join(f'  {name:<{width}} {c.summary}' for name, c in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog='dvs_closed_loop',
        description=f'Tools around the closed loop:\n\n{lines}\n',
        epilog='dvs_closed_loop COMMAND --help explains one of them.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('command', metavar='COMMAND', choices=COMMANDS)
    return parser
