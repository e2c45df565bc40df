"""Subcommand `reproduce_paper`: every figure and number of the paper."""

from __future__ import annotations

import argparse
from pathlib import Path

from dvs_common.output_folder import output_folder
from dvs_simulation.paper.reproduce import reproduce_paper


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments.

    Parameters
    ----------
    parser
        Parser of the subcommand.
    """
    parser.add_argument(
        '--output', type=Path, default=Path('out'), help='folder of the results (out)'
    )
    parser.add_argument('--no-progress', action='store_true', help='no progress bar')


def run(options: argparse.Namespace) -> int:
    """Regenerate the paper and print its table.

    Parameters
    ----------
    options
        Parsed arguments.

    Raises
    ------
    ParameterError
        If the output can't be a folder.
    """
    output = output_folder(options.output) / 'paper'
    rows = reproduce_paper(output, progress=not options.no_progress)
    print(f'{"quantity":46} {"method":12}  r  reference     ours  deviation')
    for row in rows:
        print(
            f'{row.quantity:46} {row.method:12} {row.pixels or "":>2} {row.reference:10.5g} '
            f'{row.ours:8.5g} {row.deviation_percent:+9.2f} %   ({row.source})'
        )
    print(f'report: {output / "report.html"}')
    return 0
