"""The command `dvs_closed_loop`: one door to all tools, each a module that is loaded when asked for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from dvs_interfaces.errors import SuiteError

# Name of the command: module with `add_arguments(parser)` and `run(options) -> int`, and what it does.
COMMANDS = {
    'record': ('dvs_closed_loop.record', 'record the loop\'s topics to a bag, without rosbag2'),
    'play': ('dvs_closed_loop.play', 'publish a bag again with its original spacing'),
    'report': ('dvs_closed_loop.report', 'make figures and an HTML report of a bag'),
    'dashboard': ('dvs_closed_loop.dashboard', 'serve a live page of the running loop'),
}
_USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `dvs_closed_loop`; returns the exit code.

    Parameters
    ----------
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    name = _parser().parse_args(own[:1]).command
    module_name, summary = COMMANDS[name]
    module = import_module(module_name)
    parser = argparse.ArgumentParser(
        prog=f'dvs_closed_loop {name}', description=module.__doc__ or summary
    )
    module.add_arguments(parser)
    options = parser.parse_args(own[1:])
    options.ros_arguments = ros_arguments
    try:
        return int(module.run(options))
    except SuiteError as error:
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
    lines = '\n'.join(f'  {name:<10} {summary}' for name, (_, summary) in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog='dvs_closed_loop',
        description=f'Tools around the closed loop:\n\n{lines}\n',
        epilog='dvs_closed_loop COMMAND --help explains one of them.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('command', metavar='COMMAND', choices=COMMANDS)
    return parser
