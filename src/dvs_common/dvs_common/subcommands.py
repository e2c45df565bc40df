"""Subcommands of a console script, each imported only when it is called."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module

from dvs_common.errors import SuiteError
from dvs_common.program import importing


@dataclass(frozen=True, slots=True, kw_only=True)
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


def run_subcommand(
    program: str,
    title: str,
    commands: Mapping[str, Command],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run the subcommand that a command line names; returns the exit code.

    Parameters
    ----------
    program
        Name of the console script.
    title
        First line of its help.
    commands
        Subcommands by name.
    arguments
        Command line without the program name; `sys.argv` by default.
    """
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    name = _parser(program, title, commands).parse_args(own[:1]).command
    try:
        with importing():
            module = import_module(commands[name].module)
        parser = argparse.ArgumentParser(
            prog=f'{program} {name}', description=commands[name].summary
        )
        module.add_arguments(parser)
        options = parser.parse_args(own[1:])
        options.ros_arguments = ros_arguments
        return int(module.run(options))
    except SuiteError as error:
        print(f'{program} {name}: {error}', file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f'{program} {name}: {error}', file=sys.stderr)
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


def _parser(program: str, title: str, commands: Mapping[str, Command]) -> argparse.ArgumentParser:
    width = max(map(len, commands))
    lines = '\n'.join(f'  {name:<{width}} {c.summary}' for name, c in commands.items())
    parser = argparse.ArgumentParser(
        prog=program,
        description=f'{title}:\n\n{lines}\n',
        epilog=f'{program} COMMAND --help explains one of them.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('command', metavar='COMMAND', choices=commands)
    return parser
