"""Run the benchmarks that bench.sh names, collect their figures and compare them with older ones.

A figure whose name ends in `_spread` is the relative spread of the figure before it: half the
range of its rounds over their median.
"""

from __future__ import annotations

import argparse
import importlib
import json
import platform
import re
import sys
import time
import traceback
from contextlib import redirect_stdout
from importlib.metadata import version
from pathlib import Path

from tqdm import tqdm
from tqdm.contrib import DummyTqdmFile

BENCHMARKS = (
    'loop',
    'hop',
    'latency',
    'start',
    'sampled',
    'controller',
    'cycle',
    'camera',
    'codecs',
    'exact',
    'design',
    'events',
    'scale',
)
# Of all other figures the larger one is the better one.
SMALLER_IS_BETTER = re.compile(
    r'^latency_|(?<!_per_core)_(s|ms|us|seconds|ratio|overhead|frame_pass|mb)$|_us_'
    r'|_(ms|mb)_[a-z_]+$'
)
# Of a figure that was taken once.
USUAL_SPREAD = 0.1


def slower(old: dict[str, float], new: dict[str, float]) -> list[str]:
    """Lines about what has become slower by more than the spread.

    Parameters
    ----------
    old
        Figures of an earlier run, by name.
    new
        Figures of this one.
    """
    lines = []
    for name in sorted(old.keys() & new.keys()):
        if name.endswith('_spread') or not old[name] or not new[name]:
            continue
        ratio = new[name] / old[name]
        loss = ratio - 1 if SMALLER_IS_BETTER.search(name) else 1 / ratio - 1
        spreads = (figures.get(f'{name}_spread', USUAL_SPREAD) for figures in (old, new))
        spread = max(spreads)
        if loss > spread:
            lines.append(
                f'slower: {name}: {old[name]:.4g} -> {new[name]:.4g}, {100 * loss:.0f} % '
                f'(spread {100 * spread:.0f} %)'
            )
    return lines


def _compare(path: Path, figures: dict[str, float]) -> None:
    lines = slower(json.loads(path.read_text(encoding='utf-8')), figures)
    print('\n'.join(lines) or f'nothing is slower than in {path} by more than the spread')


def main() -> int:
    """Run the chosen benchmarks; print their figures and write them as JSON."""
    parser = argparse.ArgumentParser(prog='scripts/bench.sh', description=__doc__)
    parser.add_argument('names', nargs='*', help=f'some of {", ".join(BENCHMARKS)}; default: all')
    parser.add_argument('--quick', action='store_true', help='a small run of each, to see it work')
    parser.add_argument('--json', type=Path, help='file for the figures')
    parser.add_argument(
        '--compare', type=Path, metavar='OLD', help='an older --json: print what is slower now'
    )
    options = parser.parse_args()
    unknown = set(options.names) - set(BENCHMARKS)
    if unknown:
        parser.error(f'no benchmark called {", ".join(sorted(unknown))}')
    if options.compare and not options.compare.is_file():
        parser.error(f'{options.compare} is no file')
    packages = ('numpy', 'scipy', 'numba')
    versions = ', '.join(f'{name} {version(name)}' for name in packages)
    print(f'{platform.machine()}, Python {platform.python_version()}, {versions}')
    figures: dict[str, float] = {}
    failed = []
    # No bar where the output is not a terminal's; what benchmarks print goes above it.
    with (
        tqdm(options.names or BENCHMARKS, disable=None, unit='benchmark') as bar,
        redirect_stdout(DummyTqdmFile(sys.stdout)),
    ):
        for name in bar:
            bar.set_description(name)
            print(f'== {name}')
            began = time.perf_counter()
            try:
                figures |= importlib.import_module(f'bench_{name}').measure(quick=options.quick)
            except Exception:
                traceback.print_exc()
                failed.append(name)
            print(f'   {time.perf_counter() - began:.0f} s')
            if options.json:
                # After every benchmark: what is measured is kept, whatever the next one does.
                options.json.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    if options.compare:
        _compare(options.compare, figures)
    if failed:
        print(f'scripts/bench.sh: failed: {", ".join(failed)}', file=sys.stderr)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
