#!/usr/bin/env bash
# Measures performance as ratios within one run; --json FILE keeps them. See docs/benchmarks.md.
set -euo pipefail
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
"$root/scripts/setup.sh" >/dev/null
enter_workspace
export OPENBLAS_NUM_THREADS=1
exec python "$root/scripts/bench.py" "$@"
