#!/usr/bin/env bash
# Runs an installed executable as `ros2 run PKG EXE ARGS` does; needs no ros2 command.
set -euo pipefail
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"

if [ $# -ge 1 ] && [[ "$1" == */* ]]; then
    enter_workspace
    exec "$@"
fi
if [ $# -lt 2 ] || [ "$1" = --help ]; then
    echo "usage: scripts/run.sh PKG EXE [ARGUMENT ...]"
    echo "       scripts/run.sh PATH/OF/PROGRAM [ARGUMENT ...]"
    echo
    echo "Runs install/PKG/lib/PKG/EXE; its exit code and signals pass through. With the path of a"
    echo "program (a slash in it) that program is run with ROS around it. Executables:"
    (cd "$root/install" 2>/dev/null && printf '  %s\n' */lib/*/* | sed 's|/lib/.*/| |' | grep -v '[.*]\|site-packages') || true
    [ "${1:-}" = --help ] && exit 0
    exit 2
fi
enter_workspace
executable="$root/install/$1/lib/$1/$2"
[ -x "$executable" ] || fail "no executable $2 in package $1 ($executable)"
shift 2
exec "$executable" "$@"
