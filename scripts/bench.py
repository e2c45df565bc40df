"""Run the benchmarks that bench.sh names and collect their ratios."""

from __future__ import annotations

import argparse
import importlib
import json
import platform
import sys
import traceback
from importlib.metadata import version
from pathlib import Path

BENCHMARKS = ('loop', 'cycle', 'camera', 'codecs', 'exact', 'design')


def main() -> int:
    """Run the chosen benchmarks; print their figures and write them as JSON."""
    parser = argparse.ArgumentParser(prog='scripts/bench.sh', description=__doc__)
    parser.add_argument('names', nargs='*', help=f'some of {", ".join(BENCHMARKS)}; default: all')
    parser.add_argument('--quick', action='store_true', help='a small run of each, to see it work')
    parser.add_argument('--json', type=Path, help='file for the figures')
    options = parser.parse_args()
    unknown = set(options.names) - set(BENCHMARKS)
    if unknown:
        parser.error(f'no benchmark called {", ".join(sorted(unknown))}')
    packages = ('numpy', 'scipy', 'numba')
    versions = ', '.join(f'{name} {version(name)}' for name in packages)
    print(f'{platform.machine()}, Python {platform.python_version()}, {versions}')
    figures: dict[str, float] = {}
    failed = []
    for name in options.names or BENCHMARKS:
        print(f'== {name}', flush=True)
        try:
            figures |= importlib.import_module(f'bench_{name}').measure(quick=options.quick)
        except Exception:
            traceback.print_exc()
            failed.append(name)
        if options.json:
            # After every benchmark: what is measured is kept, whatever the next one does.
            options.json.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    if failed:
        print(f'scripts/bench.sh: failed: {", ".join(failed)}', file=sys.stderr)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
