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
# A reader's own files, as the tutorial has them written, may be as they like.
ours=(src test scripts conftest.py)
ruff format --check "${ours[@]}"
ruff check "${ours[@]}"
mypy

# Most tests wait for processes to start and to meet: several at a time. A file's tests stay together.
workers=$(nproc)
[ "$workers" -le 4 ] || workers=4
chosen() {
    python -m pytest "$@" || { status=$?; [ $status = 5 ]; }    # 5: none of this kind was asked for
}
chosen -m 'not wall_clock' -n "$workers" --dist loadfile "$@"
chosen -m wall_clock "$@"
