#!/usr/bin/env bash
# Sets everything up and runs linters, type checker and all tests.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

usage() {
    cat <<'TEXT'
usage: scripts/test.sh [--fast | --long] [PYTEST ARGUMENT ...]

Sets up, runs ruff and mypy, then pytest with the given arguments.

  --fast   only the tests of the cores, without those that start a process or take seconds each
  --long   also what runs for minutes to hours; a short form of it is always run
  --help   show this text
TEXT
}

which=whole
case ${1:-} in
    --help) usage; exit 0 ;;
    --fast | --long) which=${1#--}; shift ;;
esac
"$here/setup.sh" --test
# shellcheck source=scripts/env.sh
source "$here/env.sh"
enter_workspace
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
cd "$root"
# A reader's own files, as the tutorial has them written, may be as they like.
ours=(src test scripts examples conftest.py)
ruff format --check "${ours[@]}"
ruff check "${ours[@]}"
# It takes one processor only, and that when no test wants it.
nice -n 19 mypy &
types=$!

# Most tests wait for processes to start and to meet, so that there are more of them than processors.
# conftest.py has the order, and which tests stay together.
workers() {
    local wanted=$(($(nproc) * $1))
    echo $((wanted < 8 ? wanted : 8))
}
chosen() {
    python -m pytest "$@" || { status=$?; [ $status = 5 ]; }    # 5: none of this kind was asked for
}
# Processes that meet over a middleware depend on how busy the machine is: what fails is tried once
# more, and the summary lists it.
again=(--reruns 1 -r aR)
together=(--durations 15 --dist loadgroup --no-loadscope-reorder)
cores=(src/dvs_common src/dvs_plant_sim src/dvs_event_camera src/dvs_hinf_controller src/dvs_simulation)
case $which in
    fast)
        chosen -m 'not processes and not ensemble and not wall_clock and not long' \
            "${together[@]}" -n "$(workers 1)" "$@" "${cores[@]}"
        ;;
    *)
        chosen -m 'not wall_clock and not long' "${again[@]}" "${together[@]}" -n "$(workers 3)" "$@"
        # These need half a processor each, and at once: one a processor. To collect all others again
        # takes longer than some of them.
        timed=("$@")
        [ $# -gt 0 ] || mapfile -t timed < <(grep -rlw wall_clock --include='test_*.py' test src)
        chosen -m 'wall_clock and not long' "${again[@]}" "${together[@]}" -n "$(workers 1)" "${timed[@]}"
        ;;
esac
if [ $which = long ]; then chosen -m long --timeout 0 "$@"; fi
wait "$types" || fail "mypy has found errors, see above"
echo "all passed in $((SECONDS / 60)) min $((SECONDS % 60)) s"
