"""Where the checkout is; with its packages on the path, so that a script runs without a build.

And the option by which the scripts that draw say where.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = (
    'dvs_common',
    'dvs_plant_sim',
    'dvs_event_camera',
    'dvs_hinf_controller',
    'dvs_simulation',
)
sys.path[:0] = [str(ROOT / 'src' / package) for package in PACKAGES]


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add `--output` as the programs have it: the folder, or the one file that is written there.

    Parameters
    ----------
    parser
        Where to add it.
    """
    parser.add_argument(
        '--output',
        type=Path,
        default=ROOT / 'docs' / 'figures',
        help='folder of the results (docs/figures)',
    )
