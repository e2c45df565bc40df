#!/usr/bin/env bash
# Sets everything up and runs linters, type checker and all tests.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

if [ "${1:-}" = --help ]; then
    echo "usage: scripts/test.sh [PYTEST ARGUMENT ...]"
    echo
    echo "Sets up, runs ruff and mypy, then pytest with the given arguments."
    exit 0
fi
"$here/setup.sh" --test
# shellcheck source=scripts/env.sh
source "$here/env.sh"
enter_workspace
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
cd "$root"
ruff format --check .
ruff check .
mypy
exec python -m pytest "$@"
