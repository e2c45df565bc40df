#!/usr/bin/env bash
# Sets everything up and runs the paper's experiment as three ROS 2 nodes.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

if [ "${1:-}" = --help ]; then
    echo "usage: scripts/demo.sh [SCENARIO]"
    echo
    echo "Sets up, then runs config/SCENARIO.yaml (default: paper_r3) as three nodes over Fast DDS and"
    echo "writes bag, result and figure to out/SCENARIO/. Scenarios:"
    (cd "$here/../config" && printf '  %s\n' *.yaml | sed 's/\.yaml$//')
    exit 0
fi
scenario=${1:-paper_r3}
# Before the setup, which takes minutes.
if [ ! -f "$here/../config/$scenario.yaml" ]; then
    echo "demo.sh: no scenario $scenario in config/; scripts/demo.sh --help lists them" >&2
    exit 2
fi
"$here/setup.sh"
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
exec "$here/run.sh" dvs_closed_loop closed_loop --params-file "$here/../config/$scenario.yaml"
