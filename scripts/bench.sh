#!/usr/bin/env bash
# Measures performance as ratios within one run; --json FILE keeps them. See docs/benchmarks.md.
set -euo pipefail
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
"$root/scripts/setup.sh" >/dev/null
enter_workspace
python -c 'import dkpy' 2>/dev/null ||
    python -m pip install --disable-pip-version-check -q -r "$root/requirements-bench.txt" 2>/dev/null ||
    fail "pip could not install requirements-bench.txt; is there a network, or a package index?"
exec python "$root/scripts/bench.py" "$@"
