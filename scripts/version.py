#!/usr/bin/env python3
"""Writes the version of the file VERSION into every package.xml; --check only compares."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TAG = re.compile(r'(?<=<version>)[^<]*(?=</version>)')


def main() -> int:
    """Write or compare; returns the exit code."""
    if sys.argv[1:] not in ([], ['--check']):
        print('usage: scripts/version.py [--check]', file=sys.stderr)
        return 2 if sys.argv[1:] != ['--help'] else 0
    version = (ROOT / 'VERSION').read_text(encoding='utf-8').strip()
    stale = 0
    for manifest in sorted(ROOT.glob('src/*/package.xml')):
        text = manifest.read_text(encoding='utf-8')
        wanted = TAG.sub(version, text, count=1)
        if wanted == text:
            continue
        stale += 1
        if sys.argv[1:]:
            print(f'{manifest} has another version: run scripts/version.py', file=sys.stderr)
        else:
            manifest.write_text(wanted, encoding='utf-8')
    return 1 if stale and sys.argv[1:] else 0


if __name__ == '__main__':
    sys.exit(main())
